#include "gantry/sim/faulty_drive.h"

namespace gantry {

FaultyDrive::FaultyDrive(std::unique_ptr<Drive> inner, SimulatedStage& stage, FaultyBus& bus, int unit,
                         Clock& clock)
    : inner_(std::move(inner)), stage_(stage), bus_(bus), unit_(unit), clock_(clock) {}

void FaultyDrive::raise_alarm(int code) {
  alarm_ = code;
  alarm_cause_ = true;
  stage_.set_servo(false, clock_.now_s());
}

void FaultyDrive::set_emergency_stop(bool active) {
  emergency_stop_ = active;
  if (active) stage_.set_servo(false, clock_.now_s());
}

void FaultyDrive::set_supply(bool on) {
  supply_ = on;
  if (on) return;
  stage_.lose_power(clock_.now_s());
  alarm_.reset();
  if (alarm_cause_) alarm_ = 1;
}

template <typename Act>
auto FaultyDrive::exchange(const Act& act) -> decltype(act()) {
  const auto failed = [this](FaultKind kind, const char* message) {
    return fault(kind, info().text(), message);
  };
  if (!bus_.connected) return failed(FaultKind::kUnreachable, "the connection is lost");
  if (silent_ || !supply_) return failed(FaultKind::kTimeout, "no answer");
  const auto wrong = bus_.wire.next(unit_);
  if (!wrong) return act();
  switch (*wrong) {
    case WireFault::kLoseRequest:
      return failed(FaultKind::kTimeout, "no answer");
    case WireFault::kException:
      return failed(FaultKind::kRefused, "exception 06: device busy");
    case WireFault::kDuplicateReply:
      return act();  // The second one is thrown away before the next request.
    default:
      break;
  }
  auto done = act();  // It hears, and acts; its reply suffers.
  if (*wrong == WireFault::kDropReply) return failed(FaultKind::kTimeout, "no answer");
  if (*wrong == WireFault::kDelayReply)
    return bus_.wire.delay_s() < kResponseTimeout_s ? done : failed(FaultKind::kTimeout, "no answer in time");
  return failed(FaultKind::kProtocol, "a broken answer");
}

Result<void> FaultyDrive::connect() {
  return exchange([&] { return inner_->connect(); });
}

Result<DriveStatus> FaultyDrive::read_status() {
  auto status = exchange([&] { return inner_->read_status(); });
  for (int attempt = 1; !status && attempt < kReadAttempts; ++attempt)
    status = exchange([&] { return inner_->read_status(); });
  if (!status) return status;
  status->emergency_stop = emergency_stop_;
  if (alarm_) status->alarm = alarm_;
  return status;
}

Result<void> FaultyDrive::set_servo(bool on) {
  return exchange([&]() -> Result<void> {
    if (on && (alarm_ || emergency_stop_))
      return fault(FaultKind::kRefused, info().text(),
                   "servo on refused: an alarm or emergency stop is pending");
    return inner_->set_servo(on);
  });
}

Result<void> FaultyDrive::start_homing() {
  return exchange([&] { return inner_->start_homing(); });
}

Result<void> FaultyDrive::start_move(const MoveCommand& command) {
  return exchange([&] { return inner_->start_move(command); });
}

Result<void> FaultyDrive::halt() {
  return exchange([&] { return inner_->halt(); });
}

Result<void> FaultyDrive::reset_alarm() {
  return exchange([&] {
    if (!alarm_cause_) alarm_.reset();
    return inner_->reset_alarm();
  });
}

Result<void> FaultyDrive::set_communication_timeout(double timeout_s) {
  return exchange([&] { return inner_->set_communication_timeout(timeout_s); });
}

}  // namespace gantry
