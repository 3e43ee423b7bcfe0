#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

namespace gantry {

/// How punctual a loop was. Lateness is how long after its due time a cycle began.
struct LoopStatistics {
  uint64_t cycles = 0;
  uint64_t missed =
      0;  ///< Cycles that did not take place, because one before took too long or began too late.
  double late_p50_us = 0, late_p99_us = 0, late_max_us = 0;
  double busy_p50_us = 0, busy_p99_us = 0, busy_max_us = 0;  ///< Time that the cycle itself took.
};

/// What the operating system granted.
struct RealTimeGrant {
  bool fifo = false;           ///< The loop runs under SCHED_FIFO.
  bool memory_locked = false;  ///< No page of the process is swapped out.
  std::string note;            ///< What was refused and why; empty when nothing was.
};

/// Durations as counts in bins of 10 us up to 20 ms, so that recording one neither allocates nor sorts.
/// One thread records, any may read.
class DurationHistogram {
 public:
  void record(double duration_us);
  double percentile_us(double fraction) const;  ///< Upper edge of the bin.
  double max_us() const { return max_us_.load(std::memory_order_relaxed); }

 private:
  static constexpr double kBin_us = 10;
  std::array<std::atomic<uint32_t>, 2000> bins_{};
  std::atomic<double> max_us_{0};
};

/// Keeps the pages of this process in memory, as they come into use, where that is permitted without a limit:
/// under a limit, locking would make later allocations fail. Returns why not; empty: done.
std::string lock_memory();
/// Puts the calling thread under SCHED_FIFO. Returns why not; empty: done.
std::string become_real_time(int priority);

/// A thread that calls `cycle` at a fixed period by absolute sleep (clock_nanosleep), under SCHED_FIFO and
/// with memory locked where permitted. A cycle that overruns skips what it missed: no catching up.
class RealTimeLoop {
 public:
  RealTimeLoop(double period_s, int priority, std::function<void()> cycle);
  ~RealTimeLoop();  ///< Ends after the present cycle.
  RealTimeLoop(const RealTimeLoop&) = delete;
  RealTimeLoop& operator=(const RealTimeLoop&) = delete;

  LoopStatistics statistics() const;
  const RealTimeGrant& grant() const { return grant_; }

 private:
  void run(int priority);

  const double period_s_;
  const std::function<void()> cycle_;
  std::atomic<bool> started_{false}, ending_{false};
  std::atomic<uint64_t> cycles_{0}, missed_{0};
  DurationHistogram late_, busy_;
  RealTimeGrant grant_;
  std::thread thread_;
};

}  // namespace gantry
