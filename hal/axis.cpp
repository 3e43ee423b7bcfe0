#include "gantry/hal/axis.h"

namespace gantry {

Axis::Axis(std::unique_ptr<Drive> drive, AxisKind kind, AxisLimits limits, Clock& clock)
    : drive_(std::move(drive)),
      clock_(clock),
      channel_(*drive_, clock, limits.position_at_home),
      machine_(kind, limits, channel_) {
  require_sound(limits, drive_->info().text());
}

AxisStatus Axis::status() const {
  AxisStatus status;
  status.state = machine_.state();
  status.drive = machine_.snapshot().status;
  status.target = machine_.target();
  if (machine_.error().reason != AxisReason::kNone) status.error = fault_of(machine_.error()).message;
  return status;
}

Fault Axis::fault_of(const AxisError& error) const {
  if (error.reason == AxisReason::kDriveFault) return channel_.last_fault();
  return {fault_kind(error.reason, FaultKind::kProtocol), info().text(), describe(error, kind())};
}

Fault Axis::refusal(AxisRefusal refusal, AxisTrigger command, double target, AxisState state,
                    const AxisError& error) const {
  const std::string what(to_string(command));
  const auto refused = [&](const std::string& why) {
    return Fault{FaultKind::kRefused, info().text(), what + " refused: " + why};
  };
  switch (refusal) {
    case AxisRefusal::kNotHomed:
      return refused(name() + " is not homed; run gantry-cell home --axis " + name());
    case AxisRefusal::kSoftLimit:
      return {FaultKind::kLimit, info().text(),
              what + " to " + format(target) + " refused: outside the soft limits " + format(limits().lower) +
                  " to " + format(limits().upper)};
    case AxisRefusal::kOnLimitSwitch:
      return {FaultKind::kLimit, info().text(),
              what + " to " + format(target) + " refused: " + name() +
                  " stands on a limit switch; only moves away from it are allowed"};
    case AxisRefusal::kCannotMoveUnhomed:
      return refused("this drive cannot move before it is homed; run gantry-cell home --axis " + name());
    case AxisRefusal::kNotANumber:
      return refused("target, speed and acceleration must be numbers, the last two positive");
    case AxisRefusal::kQueueFull:
      return refused("the drive's channel takes no more commands");
    case AxisRefusal::kSafety:
      return refused("the safety chain does not permit motion");
    default:
      break;
  }
  std::string why = "not allowed in state " + std::string(to_string(state));
  if (state == AxisState::kErrorStop)
    why += " (" + fault_of(error).message + "); once the cause is gone, run gantry-cell reset";
  return refused(why);
}

void Axis::follow() {
  channel_.service();
  machine_.step(channel_.latest(), clock_.now_s());
}

Result<void> Axis::connect() {
  auto connected = channel_.connect();
  machine_.step(channel_.latest(), clock_.now_s());
  return connected;
}

// Executes the command and learns of a drive that does not take it; what the drive then does is update()'s.
Result<void> Axis::started(AxisRefusal refused, AxisTrigger command, double target) {
  if (refused != AxisRefusal::kNone)
    return tl::make_unexpected(refusal(refused, command, target, machine_.state(), machine_.error()));
  const uint64_t faults_before = channel_.latest().faults;
  channel_.service();
  if (channel_.latest().faults == faults_before) return {};
  machine_.step(channel_.latest(), clock_.now_s());
  return tl::make_unexpected(channel_.last_fault());
}

Result<void> Axis::wait_while_pending() {
  for (;;) {
    follow();
    if (!machine_.enabling() && !machine_.resetting()) break;
    clock_.sleep_s(0.01);
  }
  channel_.service();  // What a failure left to be done.
  if (machine_.error().reason != AxisReason::kNone) return tl::make_unexpected(fault_of(machine_.error()));
  return {};
}

Result<void> Axis::enable() {
  auto done = started(machine_.enable(clock_.now_s()), AxisTrigger::kEnable);
  if (!done && machine_.state() != AxisState::kErrorStop) return done;
  if (!done) {
    channel_.service();
    return done;
  }
  return wait_while_pending();
}

Result<void> Axis::disable() {
  return started(machine_.disable(clock_.now_s()), AxisTrigger::kDisable);
}

Result<void> Axis::home() {
  return started(machine_.home(clock_.now_s()), AxisTrigger::kHome);
}

Result<void> Axis::move_to(double target) {
  return started(machine_.move({target, limits().speed, limits().acceleration}, clock_.now_s()),
                 AxisTrigger::kMove, target);
}

Result<void> Axis::stop() {
  return started(machine_.stop(clock_.now_s()), AxisTrigger::kStop);
}

Result<void> Axis::reset() {
  if (auto done = started(machine_.reset(clock_.now_s()), AxisTrigger::kReset); !done) return done;
  return wait_while_pending();
}

Result<AxisStatus> Axis::update() {
  const AxisState before = machine_.state();
  const uint64_t faults_before = channel_.latest().faults;
  follow();
  const bool failed_now = machine_.state() == AxisState::kErrorStop && before != AxisState::kErrorStop;
  if (failed_now) channel_.service();  // The halt, or torque off, at once.
  if (failed_now) return tl::make_unexpected(fault_of(machine_.error()));
  if (channel_.latest().faults != faults_before) return tl::make_unexpected(channel_.last_fault());
  return status();
}

void Axis::abort() {
  machine_.abort({AxisReason::kOperator}, AxisMachine::Torque::kKeep, clock_.now_s());
  channel_.service();
}

}  // namespace gantry
