#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/hal/axis_machine.h"

namespace gantry {

inline const AxisLimits kFakeLimits{.lower = -10,
                                    .upper = 100,
                                    .speed = 10,
                                    .acceleration = 100,
                                    .in_position = 0.02,
                                    .homing_timeout_s = 20,
                                    .move_margin_s = 2};

/// A drive that does as the test says: it records what was asked and reports `status`.
class FakeDrive final : public Drive {
 public:
  const DriveInfo& info() const override { return info_; }
  Result<void> connect() override { return record("connect"); }
  Result<DriveStatus> read_status() override {
    if (read_fault) return tl::make_unexpected(*read_fault);
    if (clock) status.sampled_at_s = clock->now_s();
    return status;
  }
  Result<void> set_servo(bool on) override {
    if (obeys_servo) status.servo_on = on;
    return record(on ? "servo on" : "servo off");
  }
  Result<void> start_homing() override { return record("home"); }
  Result<void> start_move(const MoveCommand& command) override {
    last_move = command;
    return record("move");
  }
  Result<void> halt() override { return record("halt"); }
  Result<void> reset_alarm() override {
    const auto done = record("reset alarm");
    if (done && reset_clears) status.alarm.reset();
    return done;
  }
  bool moves_unhomed() const override { return can_move_unhomed; }

  DriveStatus status;
  const Clock* clock = nullptr;  ///< Stamps readings; without it the test does.
  std::optional<Fault> read_fault;
  std::map<std::string, Fault> faults;  ///< Calls that fail, and how.
  bool obeys_servo = true, reset_clears = true, can_move_unhomed = false;
  std::vector<std::string> calls;
  MoveCommand last_move;

 private:
  Result<void> record(const std::string& call) {
    calls.push_back(call);
    if (const auto found = faults.find(call); found != faults.end())
      return tl::make_unexpected(found->second);
    return {};
  }

  DriveInfo info_{"tilt", "fake", ""};
};

}  // namespace gantry
