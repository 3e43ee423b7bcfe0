#include "endpoint.h"

#include <sys/eventfd.h>

#include <cstdint>

#include "gantry/foundation/error.h"

namespace gantry {

void Endpoint::prepare() {
  wake_ = Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (wake_.get() < 0) throw InputError("Modbus twin: the system has no more descriptors");
  running_ = true;
}

void Endpoint::wake() {
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_.get(), &one, sizeof one);
}

void Endpoint::stop() {
  if (!thread_.joinable()) return;
  {
    std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake();
  thread_.join();
}

void Endpoint::set_plugged(bool plugged) {
  std::unique_lock lock(mutex_);
  if (!running_) throw InputError("Modbus twin: an endpoint that was not started has no plug");
  plugged_wanted_ = plugged;
  wake();
  changed_.wait(lock, [&] { return plugged_ == plugged; });
}

Endpoint::Wish Endpoint::wish() {
  uint64_t count;
  [[maybe_unused]] const ssize_t got = ::read(wake_.get(), &count, sizeof count);
  std::lock_guard lock(mutex_);
  return {stop_, plugged_wanted_};
}

void Endpoint::done(bool plugged) {
  {
    std::lock_guard lock(mutex_);
    plugged_ = plugged;
  }
  changed_.notify_all();
}

}  // namespace gantry
