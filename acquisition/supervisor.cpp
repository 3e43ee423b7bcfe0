#include "gantry/acquisition/supervisor.h"

#include <algorithm>
#include <string>

namespace gantry {

void require_sound(const SupervisorSettings& settings) {
  const auto require = [](bool ok, const char* what) {
    if (!ok) throw InputError(std::string("supervisor: ") + what);
  };
  require(settings.period_s > 0, "the period must be positive");
  require(settings.stall_limit_s > 2 * settings.period_s, "the stall limit must be longer than two periods");
  require(settings.dead_man_s > 2 * settings.period_s, "the dead-man time must be longer than two periods");
}

Supervisor::Supervisor(std::vector<Axis*> axes, const SupervisorSettings& settings, MotionPermit* permit)
    : axes_(std::move(axes)), settings_(settings), permit_(permit) {
  require_sound(settings);
  if (axes_.size() > kMaxAxes)
    throw InputError("a cell may have " + std::to_string(kMaxAxes) + " axes, not " +
                     std::to_string(axes_.size()));
}

// ---- Any thread -------------------------------------------------------------------------------

uint64_t Supervisor::request(const MotionRequest& request) {
  std::lock_guard lock(mutex_);
  if (requested_ != status_.answered) return 0;
  mailbox_ = request;
  return ++requested_;
}

void Supervisor::stop(bool as_error) {
  if (as_error) {
    stop_.store(Stop::kError);
  } else {
    Stop none = Stop::kNone;  // A stop with an error is the stronger one.
    stop_.compare_exchange_strong(none, Stop::kControlled);
  }
}

SupervisorStatus Supervisor::status() const {
  std::lock_guard lock(mutex_);
  return status_;
}

// ---- The loop ---------------------------------------------------------------------------------

void Supervisor::tick(double now_s) {
  heartbeat_.beat(now_s);
  bool reset_wanted = false;
  bool new_request = false;
  {
    std::lock_guard lock(mutex_);
    new_request = requested_ != next_.answered;
    if (new_request) present_ = mailbox_;
  }
  reset_wanted = new_request && present_.command == AxisTrigger::kReset;
  required_ = permit_ ? permit_->required_stop(now_s, reset_wanted) : StopCategory::kNone;
  for (Axis* axis : axes_) axis->machine().step(axis->channel().latest(), now_s);
  couple(now_s);
  obey_permit(now_s);
  obey_stop(now_s);
  watch_the_dead_man(now_s);
  if (new_request) answer_request(now_s);
  publish(now_s);
}

// One axis in ErrorStop is enough: all others stop in the same cycle.
void Supervisor::couple(double now_s) {
  for (size_t i = 0; i < axes_.size(); ++i) {
    const bool in_error = axes_[i]->machine().state() == AxisState::kErrorStop;
    const bool new_error = in_error && !was_in_error_[i];
    was_in_error_[i] = in_error;
    if (!new_error || axes_[i]->machine().error().reason == AxisReason::kOtherAxis) continue;
    next_.first_failed = i;
    for (size_t k = 0; k < axes_.size(); ++k) {
      if (k == i) continue;
      axes_[k]->machine().abort({AxisReason::kOtherAxis, static_cast<int>(i)}, AxisMachine::Torque::kKeep,
                                now_s);
      was_in_error_[k] = axes_[k]->machine().state() == AxisState::kErrorStop;
    }
  }
}

void Supervisor::obey_permit(double now_s) {
  next_.stop = required_;
  if (required_ == StopCategory::kNone) return;
  const bool at_once = required_ == StopCategory::kCategory0;
  const AxisError error{AxisReason::kSafety, at_once ? 0 : 1};
  for (size_t i = 0; i < axes_.size(); ++i) {
    axes_[i]->machine().abort(
        error, at_once ? AxisMachine::Torque::kOffAtOnce : AxisMachine::Torque::kOffAtRest, now_s);
    was_in_error_[i] = axes_[i]->machine().state() == AxisState::kErrorStop;
  }
}

void Supervisor::stop_all(double now_s) {
  for (Axis* axis : axes_) {
    if (axis->machine().enabling())
      axis->machine().disable(now_s);
    else
      axis->machine().stop(now_s);  // Refused where nothing can move.
  }
  held_ = false;
}

void Supervisor::obey_stop(double now_s) {
  const Stop stop = stop_.exchange(Stop::kNone);
  if (stop == Stop::kControlled) stop_all(now_s);
  if (stop != Stop::kError) return;
  for (size_t i = 0; i < axes_.size(); ++i) {
    axes_[i]->machine().abort({AxisReason::kOperator}, AxisMachine::Torque::kKeep, now_s);
    was_in_error_[i] = axes_[i]->machine().state() == AxisState::kErrorStop;
  }
}

void Supervisor::watch_the_dead_man(double now_s) {
  if (!held_) return;
  const bool moving = std::any_of(axes_.begin(), axes_.end(), [](Axis* axis) {
    return axis->machine().state() == AxisState::kDiscreteMotion;
  });
  if (!moving) {
    held_ = false;
  } else if (now_s - alive_s_.load(std::memory_order_relaxed) > settings_.dead_man_s) {
    next_.dead_man_released = true;
    stop_all(now_s);
  }
}

void Supervisor::answer_request(double now_s) {
  const Refused refused = start(present_, now_s);
  next_.refusal = refused.refusal;
  next_.refused_axis = refused.axis;
  ++next_.answered;
}

Supervisor::Refused Supervisor::check(const MotionRequest& request) const {
  const bool permitted = required_ == StopCategory::kNone || request.command == AxisTrigger::kDisable;
  for (size_t i = 0; i < axes_.size(); ++i) {
    if (!(request.axes & axis_bit(i))) continue;
    if (!permitted) return {AxisRefusal::kSafety, i};
    const AxisMachine& machine = axes_[i]->machine();
    AxisRefusal refusal = AxisRefusal::kNone;
    if (request.command == AxisTrigger::kMove)
      refusal = machine.check_move(request.moves[i]);
    else if (request.command == AxisTrigger::kJog)
      refusal = machine.check_jog(request.moves[i]);
    else
      refusal = machine.check(request.command);
    if (refusal != AxisRefusal::kNone) return {refusal, i};
  }
  // One axis that is in error keeps the whole cell from moving.
  for (size_t i = 0; i < axes_.size(); ++i)
    if (axes_[i]->machine().state() == AxisState::kErrorStop && request.command != AxisTrigger::kDisable)
      return {AxisRefusal::kWrongState, i};
  return {};
}

Supervisor::Refused Supervisor::start(const MotionRequest& request, double now_s) {
  if (request.command == AxisTrigger::kStop) {
    stop_all(now_s);
    return {};
  }
  if (request.command == AxisTrigger::kReset) {
    for (Axis* axis : axes_)
      if (axis->machine().state() == AxisState::kErrorStop) axis->machine().reset(now_s);
    return {};
  }
  if (const Refused refused = check(request); refused.refusal != AxisRefusal::kNone) return refused;
  for (size_t i = 0; i < axes_.size(); ++i) {
    if (!(request.axes & axis_bit(i))) continue;
    AxisMachine& machine = axes_[i]->machine();
    AxisRefusal refusal = AxisRefusal::kNone;
    switch (request.command) {
      case AxisTrigger::kEnable:
        refusal = machine.enable(now_s);
        break;
      case AxisTrigger::kDisable:
        refusal = machine.disable(now_s);
        break;
      case AxisTrigger::kHome:
        refusal = machine.home(now_s);
        break;
      case AxisTrigger::kMove:
        refusal = machine.move(request.moves[i], now_s);
        break;
      case AxisTrigger::kJog:
        refusal = machine.jog(request.moves[i], now_s);
        break;
      default:
        refusal = AxisRefusal::kWrongState;
    }
    if (refusal != AxisRefusal::kNone) {
      couple(now_s);  // A channel that is full has put its axis into ErrorStop.
      return {refusal, i};
    }
  }
  if (request.command == AxisTrigger::kJog) {
    held_ = request.hold_to_run;
    next_.dead_man_released = false;
    keep_alive(now_s);
  }
  return {};
}

void Supervisor::publish(double now_s) {
  for (size_t i = 0; i < axes_.size(); ++i) {
    const AxisMachine& machine = axes_[i]->machine();
    AxisFigures& figures = next_.axes[i];
    figures.state = machine.state();
    figures.error = machine.error();
    figures.drive = machine.snapshot();
    figures.target = machine.target();
    figures.pending = machine.enabling() || machine.resetting();
  }
  ++next_.cycles;
  next_.now_s = now_s;
  std::lock_guard lock(mutex_);
  status_ = next_;
}

}  // namespace gantry
