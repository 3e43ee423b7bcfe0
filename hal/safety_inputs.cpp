#include "gantry/hal/safety_inputs.h"

#include <algorithm>

namespace gantry {

SafetyInputsChannel::SafetyInputsChannel(std::unique_ptr<SafetyInputs> inputs, Clock& clock)
    : inputs_(std::move(inputs)), clock_(clock) {}

void SafetyInputsChannel::service() {
  const double asked_at_s = clock_.now_s();
  Result<std::vector<bool>> levels = inputs_->read();
  if (levels && levels->size() > SafetyInputsSnapshot::kMaxChannels)
    levels = fault(FaultKind::kProtocol, inputs_->device(),
                   "delivered " + std::to_string(levels->size()) + " channels, " +
                       std::to_string(SafetyInputsSnapshot::kMaxChannels) + " at most are used");
  std::lock_guard lock(mutex_);
  ++health_.readings;
  if (!levels) {
    ++health_.faults;
    health_.last_fault = levels.error().text();
    return;
  }
  latest_.valid = true;
  latest_.sampled_at_s = asked_at_s;
  latest_.count = levels->size();
  latest_.closed.fill(false);
  std::copy(levels->begin(), levels->end(), latest_.closed.begin());
}

SafetyInputsSnapshot SafetyInputsChannel::latest() const {
  std::lock_guard lock(mutex_);
  return latest_;
}

SafetyInputsHealth SafetyInputsChannel::health() const {
  std::lock_guard lock(mutex_);
  return health_;
}

}  // namespace gantry
