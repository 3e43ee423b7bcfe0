#pragma once

#include <memory>
#include <mutex>

#include "gantry/acquisition/motion_permit.h"
#include "gantry/acquisition/safety_chain.h"
#include "gantry/hal/safety_inputs.h"

namespace gantry {

/// The safety chain as a permit of the motion supervisor: asks the channel for its latest reading (no I/O)
/// and lets the chain judge it. Somebody else must call the channel's service(), often enough for max_age_s.
/// required_stop() belongs to one thread; verdict() and why() may be called from any.
class SafetyPermit final : public MotionPermit {
 public:
  SafetyPermit(const SafetySettings& settings, std::shared_ptr<const SafetyInputsChannel> channel);

  StopCategory required_stop(double now_s, bool reset_requested) override;
  std::string why() const override;
  SafetyVerdict verdict() const;
  /// What the last reset that was tried came to: a verdict shows it for one cycle only.
  SafetyReset last_reset() const;

 private:
  SafetyChain chain_;
  std::shared_ptr<const SafetyInputsChannel> channel_;
  mutable std::mutex mutex_;  ///< Held for copies only.
  SafetyVerdict verdict_;
  SafetyReset last_reset_ = SafetyReset::kNone;
};

}  // namespace gantry
