#include "gantry/foundation/clock.h"

#include <algorithm>
#include <chrono>
#include <thread>

namespace gantry {

double SteadyClock::now_s() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void SteadyClock::sleep_s(double duration_s) {
  if (duration_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(duration_s));
}

double VirtualClock::now_s() const {
  std::lock_guard lock(mutex_);
  return now_s_;
}

void VirtualClock::sleep_s(double duration_s) {
  std::lock_guard lock(mutex_);
  now_s_ += std::max(0.0, duration_s);
}

}  // namespace gantry
