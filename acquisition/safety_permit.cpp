#include "gantry/acquisition/safety_permit.h"

namespace gantry {

SafetyPermit::SafetyPermit(const SafetySettings& settings, std::shared_ptr<const SafetyInputsChannel> channel)
    : chain_(settings), channel_(std::move(channel)) {}

StopCategory SafetyPermit::required_stop(double now_s, bool reset_requested) {
  const SafetyVerdict verdict = chain_.update(channel_->latest(), reset_requested, now_s);
  std::lock_guard lock(mutex_);
  verdict_ = verdict;
  if (verdict.reset != SafetyReset::kNone) last_reset_ = verdict.reset;
  return verdict.stop;
}

SafetyVerdict SafetyPermit::verdict() const {
  std::lock_guard lock(mutex_);
  return verdict_;
}

SafetyReset SafetyPermit::last_reset() const {
  std::lock_guard lock(mutex_);
  return last_reset_;
}

std::string SafetyPermit::why() const {
  const SafetyVerdict now = verdict();
  std::string text = describe(now, chain_.settings());
  if (now.cause == SafetyCause::kNoData) {
    const SafetyInputsHealth health = channel_->health();
    if (!health.last_fault.empty()) text += " (last: " + health.last_fault + ")";
  }
  return text;
}

}  // namespace gantry
