#pragma once

#include <mutex>

namespace gantry {

/// The time, injected wherever code waits or stamps, so that a cell can run faster than real time
/// and a test never sleeps for luck. Seconds since an arbitrary start, never going backwards.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual double now_s() const = 0;
  virtual void sleep_s(double duration_s) = 0;
};

/// Real time.
class SteadyClock final : public Clock {
 public:
  double now_s() const override;
  void sleep_s(double duration_s) override;
};

/// Time that passes only when somebody sleeps: sleeping returns at once. Thread-safe.
class VirtualClock final : public Clock {
 public:
  double now_s() const override;
  void sleep_s(double duration_s) override;

 private:
  mutable std::mutex mutex_;
  double now_s_ = 0.0;
};

}  // namespace gantry
