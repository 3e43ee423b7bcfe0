#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gantry/acquisition/motion_permit.h"
#include "gantry/hal/safety_inputs.h"

namespace gantry {

/// One device of the chain: an emergency stop, a door, a light curtain.
struct SafetyInputSettings {
  std::string name;
  std::vector<int> channels;  ///< Addresses of one or two discrete inputs (PDU addresses, from 0).
  StopCategory stop = StopCategory::kCategory0;  ///< What its tripping requires; not kNone.
  /// Two channels: how long they may disagree; longer is a fault of the input.
  double discrepancy_s = 0.1;
  /// Closed counts as released once it was read closed, and nothing else, for this long (contacts bounce).
  double release_s = 0.05;
};

/// The logic of the chain. docs/safety.md explains every number.
struct SafetySettings {
  std::vector<SafetyInputSettings> inputs;
  double max_age_s = 0.1;  ///< A reading older than this counts as everything tripped.
  /// A stop of category 1 becomes one of category 0 after this time, whether the axes have come to rest or
  /// not ("safe stop 1, time controlled", IEC 61800-5-2).
  double ramp_limit_s = 2.0;

  size_t channel_count() const;
};

/// What keeps the chain from allowing motion, the most serious one first.
enum class SafetyCause {
  kNone,
  kNoData,       ///< No reading, or one older than max_age_s.
  kDiscrepancy,  ///< Two channels disagreed for too long: a latched fault of that input.
  kTripped,      ///< An input is open, or not closed for release_s yet.
  kStopping,     ///< All inputs are released, but the stop of category 1 has not ended in torque off yet.
  kResetNeeded,  ///< All is well but for the latch: a reset edge is needed.
  kStart         ///< Only as what latched the chain: the program has started.
};

/// What became of the reset in this update.
enum class SafetyReset { kNone, kAccepted, kRefused };

/// Plain data: made in every cycle without allocating.
struct SafetyVerdict {
  StopCategory stop = StopCategory::kCategory0;
  bool motion_allowed = false;  ///< The same as stop == kNone.
  SafetyCause cause = SafetyCause::kNoData;
  int input = -1;  ///< Index of the input that is the cause; -1: none in particular.
  SafetyCause latched_by = SafetyCause::kStart;
  int latched_by_input = -1;
  SafetyReset reset = SafetyReset::kNone;
};

/// The safety chain of the cell as a pure state machine: no I/O, no clock, no allocation in update().
/// It never replaces the hardware chain (docs/safety.md): it follows it, so that software knows why the
/// motors are without torque and does not start by itself when they get it back.
///
/// Rules:
/// - Starts latched. Any input that is not released latches it. Nothing but a reset unlatches it.
/// - A reset is a rising edge of reset_requested with every input released and the stop completed; any other
///   edge is refused and forgotten. A level that is high from the start is no edge.
/// - Opening is acted on at once, by the first reading that shows it; closing is debounced by release_s.
/// - The stop is the highest that any input has required since the last reset: category 0 over category 1;
///   category 1 becomes category 0 after ramp_limit_s.
/// - Two channels that disagree for longer than discrepancy_s are a fault, which goes away only when both
///   have been read open in one reading and both are released after that.
/// - Times between readings are counted by the readings' own time stamps: what was not read proves nothing.
class SafetyChain {
 public:
  /// Throws InputError for settings that contradict each other.
  explicit SafetyChain(const SafetySettings& settings);

  /// `snapshot` holds the channels of all inputs one after the other, in the order of the settings.
  SafetyVerdict update(const SafetyInputsSnapshot& snapshot, bool reset_requested, double now_s);

  const SafetySettings& settings() const { return settings_; }

 private:
  struct Input {
    enum class Fault { kNone, kLatched, kSeenOpen };
    std::optional<double> differing_since_s;
    std::optional<double> closed_since_s;
    Fault fault = Fault::kNone;
    bool released = false;
  };

  bool is_fresh(const SafetyInputsSnapshot& snapshot, double now_s) const;
  static void follow(Input& input, const SafetyInputSettings& settings, bool first, bool second,
                     double sampled_at_s);
  void latch(StopCategory category, const SafetyVerdict& why, double now_s);

  SafetySettings settings_;
  std::vector<Input> inputs_;
  double last_sample_s_;
  StopCategory latched_ = StopCategory::kCategory0;  ///< kNone: not latched.
  SafetyCause latched_by_ = SafetyCause::kStart;
  int latched_by_input_ = -1;
  double category1_since_s_ = 0;
  bool previous_reset_ = true;
};

/// "door is tripped", "waiting for a reset (door was tripped)", ... for a person.
std::string describe(const SafetyVerdict& verdict, const SafetySettings& settings);

}  // namespace gantry
