#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "gantry/acquisition/real_time_loop.h"
#include "gantry/acquisition/supervisor.h"

namespace gantry {

/// Other I/O that the loop depends on, like the safety inputs: `service` does one blocking exchange, `bus` is
/// the bus that it shares with axes of that number, or one of its own.
struct IoService {
  size_t bus = 0;
  std::function<void()> service;
};

/// Runs a supervisor in real time: its loop on one thread, and one I/O thread for each bus, which
/// services the channels of that bus in turn. Watchdogs look both ways: the loop sees readings that grow
/// old, and an I/O thread that sees no loop halts its drives.
class MotionThreads {
 public:
  /// `bus_of_axis`: axes with the same number share a thread. `clock` must follow real time.
  MotionThreads(Supervisor& supervisor, const std::vector<size_t>& bus_of_axis,
                const std::vector<IoService>& services, Clock& clock);
  /// Ends the loop first; the I/O threads then carry out what is still owed.
  ~MotionThreads();

  LoopStatistics statistics() const { return loop_->statistics(); }
  const RealTimeGrant& grant() const { return loop_->grant(); }

 private:
  class IoThread;

  Supervisor& supervisor_;
  std::vector<std::unique_ptr<IoThread>> io_;
  std::unique_ptr<RealTimeLoop> loop_;
};

}  // namespace gantry
