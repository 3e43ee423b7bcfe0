#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>

namespace gantry {

/// A thread for calls that may block for seconds, with a caller who will not wait that long. Work is
/// done in the order given. Work that the caller gave up on before it began is skipped; work that is
/// under way is left to end by itself, and its result is destroyed on this thread.
class ControlThread {
 public:
  ControlThread();
  /// Lets queued work end, but waits for it no longer than about a second: then the thread is left
  /// behind and ends when the work does.
  ~ControlThread();
  ControlThread(const ControlThread&) = delete;
  ControlThread& operator=(const ControlThread&) = delete;

  /// The result of `work`, or nothing when it was not there after `timeout_s`. `work` may outlive the
  /// call, so it must own what it uses.
  template <typename T>
  std::optional<T> run(std::function<T()> work, double timeout_s);

  /// Does `work` when its turn comes.
  void post(std::function<void()> work);

  /// Leaves all work so far to itself, on the old thread, and begins a new one for what follows.
  void renew();

 private:
  struct Queue;
  void start();

  std::shared_ptr<Queue> queue_;
};

template <typename T>
std::optional<T> ControlThread::run(std::function<T()> work, double timeout_s) {
  struct Call {
    std::mutex mutex;
    std::condition_variable changed;
    std::optional<T> result;
    bool given_up = false;
  };
  auto call = std::make_shared<Call>();
  post([call, work = std::move(work)] {
    {
      std::lock_guard lock(call->mutex);
      if (call->given_up) return;
    }
    T result = work();
    std::lock_guard lock(call->mutex);
    if (call->given_up) return;
    call->result = std::move(result);
    call->changed.notify_one();
  });
  std::unique_lock lock(call->mutex);
  call->changed.wait_for(lock, std::chrono::duration<double>(timeout_s),
                         [&] { return call->result.has_value(); });
  call->given_up = !call->result.has_value();
  return std::move(call->result);
}

}  // namespace gantry
