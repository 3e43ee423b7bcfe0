#include "gantry/hal/drive_channel.h"

namespace gantry {

DriveChannel::DriveChannel(Drive& drive, Clock& clock, double position_at_home)
    : drive_(drive), clock_(clock), position_at_home_(position_at_home) {}

bool DriveChannel::post(const DriveCommand& command) {
  Waker* waker = nullptr;
  {
    std::lock_guard lock(mutex_);
    if (command.action == DriveAction::kHalt || command.action == DriveAction::kServoOff) {
      waiting_ = 0;
      (command.action == DriveAction::kHalt ? halt_owed_ : servo_off_owed_) = ++posted_;
    } else {
      if (waiting_ == kCapacity) return false;
      queue_[(first_ + waiting_) % kCapacity] = {command, ++posted_};
      ++waiting_;
    }
    waker = waker_;
  }
  if (waker) waker->wake();
  return true;
}

uint64_t DriveChannel::posted() const {
  std::lock_guard lock(mutex_);
  return posted_;
}

DriveSnapshot DriveChannel::latest() const {
  std::lock_guard lock(mutex_);
  return snapshot_;
}

void DriveChannel::watch(const LoopHeartbeat* loop, double limit_s, Waker* waker) {
  std::lock_guard lock(mutex_);
  loop_ = loop;
  stall_limit_s_ = limit_s;
  waker_ = waker;
}

Fault DriveChannel::last_fault() const {
  std::lock_guard lock(text_mutex_);
  return last_fault_;
}

// The most urgent of what waits; it stays owed, or in its place, until finished() says otherwise.
std::optional<DriveChannel::Numbered> DriveChannel::take() {
  std::lock_guard lock(mutex_);
  if (servo_off_owed_) return Numbered{{DriveAction::kServoOff, {}}, servo_off_owed_};
  if (halt_owed_) return Numbered{{DriveAction::kHalt, {}}, halt_owed_};
  if (waiting_ == 0) return std::nullopt;
  const Numbered next = queue_[first_];
  first_ = (first_ + 1) % kCapacity;
  --waiting_;
  return next;
}

void DriveChannel::finished(const Numbered& command) {
  std::lock_guard lock(mutex_);
  // A newer command of the kind may have come meanwhile: then one is still owed.
  if (servo_off_owed_ == command.number) servo_off_owed_ = 0;
  if (halt_owed_ == command.number) halt_owed_ = 0;
  if (command.number > executed_) executed_ = command.number;
}

Result<void> DriveChannel::execute(const DriveCommand& command) {
  switch (command.action) {
    case DriveAction::kServoOn:
      return drive_.set_servo(true);
    case DriveAction::kServoOff:
      return drive_.set_servo(false);
    case DriveAction::kHome:
      return drive_.start_homing();
    case DriveAction::kMove: {
      MoveCommand move = command.move;
      move.target -= position_at_home_;
      return drive_.start_move(move);
    }
    case DriveAction::kHalt:
      return drive_.halt();
    case DriveAction::kResetAlarm:
      return drive_.reset_alarm();
  }
  return {};
}

void DriveChannel::failed(const Fault& fault) {
  {
    std::lock_guard lock(text_mutex_);
    last_fault_ = fault;
  }
  std::lock_guard lock(mutex_);
  if (waiting_ > 0) {
    executed_ = queue_[(first_ + waiting_ - 1) % kCapacity].number;
    waiting_ = 0;
  }
  ++snapshot_.faults;
  snapshot_.last_fault = fault.kind;
}

void DriveChannel::watch_the_loop(double now_s) {
  std::lock_guard lock(mutex_);
  const bool late = loop_ && now_s - loop_->last_s() > stall_limit_s_;
  if (late && !stalled_) {
    waiting_ = 0;
    halt_owed_ = ++posted_;
    ++snapshot_.stalls;
  }
  stalled_ = late;
}

void DriveChannel::service() {
  watch_the_loop(clock_.now_s());
  while (const auto command = take()) {
    const auto done = execute(command->command);
    const bool owed =
        command->command.action == DriveAction::kHalt || command->command.action == DriveAction::kServoOff;
    if (done || !owed) finished(*command);
    if (!done) return failed(done.error());
  }
  // Before the reading: a command that is posted meanwhile is not in it.
  uint64_t executed = 0;
  {
    std::lock_guard lock(mutex_);
    executed = executed_;
  }
  auto status = drive_.read_status();
  if (!status) return failed(status.error());
  status->position += position_at_home_;
  std::lock_guard lock(mutex_);
  snapshot_.status = *status;
  snapshot_.read = true;
  snapshot_.executed = executed;
}

Result<void> DriveChannel::connect() {
  if (auto connected = drive_.connect(); !connected) {
    failed(connected.error());
    return connected;
  }
  const uint64_t faults_before = latest().faults;
  service();
  if (latest().faults != faults_before) return tl::make_unexpected(last_fault());
  return {};
}

}  // namespace gantry
