#include "control_thread.h"

#include <deque>
#include <thread>

namespace gantry {

namespace {

constexpr std::chrono::milliseconds kFarewell(1200);

}  // namespace

/// Shared with the thread, which may outlive its owner.
struct ControlThread::Queue {
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<std::function<void()>> work;
  bool closing = false;
  bool ended = false;

  void serve() {
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [this] { return closing || !work.empty(); });
      if (work.empty()) break;
      std::function<void()> next = std::move(work.front());
      work.pop_front();
      lock.unlock();
      next();
      next = nullptr;  // What it owned goes here, on this thread and outside the lock.
      lock.lock();
    }
    ended = true;
    changed.notify_all();
  }
};

ControlThread::ControlThread() {
  start();
}

void ControlThread::start() {
  queue_ = std::make_shared<Queue>();
  std::thread([queue = queue_] { queue->serve(); }).detach();
}

void ControlThread::renew() {
  {
    std::lock_guard lock(queue_->mutex);
    queue_->closing = true;
    queue_->changed.notify_all();
  }
  start();
}

ControlThread::~ControlThread() {
  std::unique_lock lock(queue_->mutex);
  queue_->closing = true;
  queue_->changed.notify_all();
  queue_->changed.wait_for(lock, kFarewell, [this] { return queue_->ended; });
}

void ControlThread::post(std::function<void()> work) {
  std::lock_guard lock(queue_->mutex);
  queue_->work.push_back(std::move(work));
  queue_->changed.notify_all();
}

}  // namespace gantry
