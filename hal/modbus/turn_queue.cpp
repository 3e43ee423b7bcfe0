#include "modbus/turn_queue.h"

namespace gantry {

const TurnQueue::Caller* TurnQueue::next() const {
  const Caller* best = nullptr;
  uint64_t best_served = 0;
  for (const Caller& caller : waiting_) {
    if (caller.urgent) return &caller;
    const auto served = last_served_.find(caller.unit);
    const uint64_t turn = served == last_served_.end() ? 0 : served->second;
    if (!best || turn < best_served) {
      best = &caller;
      best_served = turn;
    }
  }
  return best;
}

TurnQueue::Turn TurnQueue::take(int unit, bool urgent) {
  std::unique_lock lock(mutex_);
  const auto me = waiting_.insert(waiting_.end(), {unit, urgent});
  changed_.wait(lock, [&] { return !busy_ && next() == &*me; });
  waiting_.erase(me);
  busy_ = true;
  last_served_[unit] = ++turns_;
  return Turn(*this);
}

void TurnQueue::end() {
  {
    std::lock_guard lock(mutex_);
    busy_ = false;
  }
  changed_.notify_all();
}

size_t TurnQueue::waiting() const {
  std::lock_guard lock(mutex_);
  return waiting_.size();
}

}  // namespace gantry
