#pragma once

#include <condition_variable>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>

namespace gantry {

/// Who may use a bus next. One at a time; urgent callers (a halt) before all others; otherwise the unit that
/// has waited longest since it was last served, so that a drive that is polled hard does not starve its
/// neighbours.
class TurnQueue {
 public:
  /// The turn of its owner, until it is destroyed.
  class Turn {
   public:
    explicit Turn(TurnQueue& queue) : queue_(queue) {}
    ~Turn() { queue_.end(); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    TurnQueue& queue_;
  };

  /// Blocks until it is this caller's turn.
  Turn take(int unit, bool urgent);
  /// How many wait.
  size_t waiting() const;

 private:
  struct Caller {
    int unit;
    bool urgent;
  };
  const Caller* next() const;
  void end();

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Caller> waiting_;            ///< In the order of their arrival.
  std::map<int, uint64_t> last_served_;  ///< By unit; the number of the turn.
  uint64_t turns_ = 0;
  bool busy_ = false;
};

}  // namespace gantry
