#include "drive_bank.h"

#include <algorithm>
#include <cmath>

namespace gantry {

void DriveBank::add(int unit, std::unique_ptr<TwinDrive> drive) {
  if (unit < 1 || unit > 247)
    throw InputError("Modbus unit " + std::to_string(unit) + " is not within 1 to 247");
  std::lock_guard lock(mutex_);
  if (!drives_.try_emplace(unit, std::move(drive)).second)
    throw InputError("Modbus unit " + std::to_string(unit) + " is used twice on one endpoint");
}

std::optional<DriveBank::Reply> DriveBank::answer(int unit, std::span<const uint8_t> pdu, bool gateway) {
  const std::optional<WireFault> fault = faults_.next(unit);
  if (fault == WireFault::kLoseRequest) return std::nullopt;
  std::lock_guard lock(mutex_);
  const auto drive = drives_.find(unit);
  if (drive == drives_.end()) {
    if (!gateway) return std::nullopt;
    return Reply{exception_reply(pdu[0], ModbusException::kGatewayTargetSilent), fault};
  }
  if (fault == WireFault::kException) return Reply{exception_reply(pdu[0], ModbusException::kBusy), fault};
  return Reply{answer_request(*drive->second, pdu, clock_.now_s()), fault};
}

void ReplyQueue::push(DriveBank& bank, const DriveBank::Reply& reply, int unit, int client,
                      std::vector<uint8_t> frame, size_t corruptible, double due_s) {
  if (reply.fault == WireFault::kDropReply) return;
  if (reply.fault == WireFault::kDelayReply) due_s += bank.faults().delay_s();
  if (reply.fault == WireFault::kTruncateReply) frame.resize(1 + bank.faults().pick(frame.size() - 1));
  if (reply.fault == WireFault::kCorruptReply) {
    const size_t bit = bank.faults().pick(8 * std::min(corruptible, frame.size()));
    frame[bit / 8] = static_cast<uint8_t>(frame[bit / 8] ^ 1u << bit % 8);
  }
  for (const Waiting& earlier : waiting_)
    if (earlier.unit == unit) due_s = std::max(due_s, earlier.due_s);
  for (int copies = reply.fault == WireFault::kDuplicateReply ? 2 : 1; copies > 0; --copies) {
    const auto later = std::upper_bound(waiting_.begin(), waiting_.end(), due_s,
                                        [](double due, const Waiting& w) { return due < w.due_s; });
    waiting_.insert(later, {due_s, unit, client, frame});
  }
}

std::optional<ReplyQueue::Waiting> ReplyQueue::pop(double now_s) {
  if (waiting_.empty() || waiting_.front().due_s > now_s) return std::nullopt;
  Waiting next = std::move(waiting_.front());
  waiting_.erase(waiting_.begin());
  return next;
}

int ReplyQueue::poll(std::span<pollfd> polled, double now_s) const {
  if (waiting_.empty()) return ::ppoll(polled.data(), polled.size(), nullptr, nullptr);
  const double seconds = std::clamp(waiting_.front().due_s - now_s, 0.0, 1e6);
  timespec timeout{};
  timeout.tv_sec = static_cast<time_t>(seconds);
  timeout.tv_nsec = static_cast<long>((seconds - std::floor(seconds)) * 1e9);
  return ::ppoll(polled.data(), polled.size(), &timeout, nullptr);
}

}  // namespace gantry
