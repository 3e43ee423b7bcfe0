#include "gantry/acquisition/safety_chain.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <set>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

void require(bool ok, const std::string& what) {
  if (!ok) throw InputError("safety: " + what);
}

void validate(const SafetySettings& settings) {
  require(!settings.inputs.empty(), "at least one input is needed");
  require(settings.max_age_s > 0 && std::isfinite(settings.max_age_s), "max_age_s must be positive");
  require(settings.ramp_limit_s >= 0 && std::isfinite(settings.ramp_limit_s),
          "ramp_limit_s must not be negative");
  require(settings.channel_count() <= SafetyInputsSnapshot::kMaxChannels,
          std::to_string(settings.channel_count()) + " channels, " +
              std::to_string(SafetyInputsSnapshot::kMaxChannels) + " at most are supported");
  std::set<std::string> names;
  std::set<int> channels;
  for (const SafetyInputSettings& input : settings.inputs) {
    const std::string who = "input '" + input.name + "': ";
    require(!input.name.empty() && names.insert(input.name).second, who + "names must differ");
    require(input.channels.size() == 1 || input.channels.size() == 2, who + "one or two channels are needed");
    for (const int channel : input.channels) {
      require(channel >= 0 && channel <= 0xFFFF, who + "channels are addresses from 0 to 65535");
      require(channels.insert(channel).second, who + "channel " + std::to_string(channel) + " is used twice");
    }
    require(input.stop != StopCategory::kNone, who + "a stop category is needed");
    require(input.discrepancy_s >= 0 && std::isfinite(input.discrepancy_s),
            who + "discrepancy_s must not be negative");
    require(input.release_s >= 0 && std::isfinite(input.release_s), who + "release_s must not be negative");
  }
}

std::string milliseconds(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%g ms", seconds * 1e3);
  return text;
}

}  // namespace

size_t SafetySettings::channel_count() const {
  size_t count = 0;
  for (const SafetyInputSettings& input : inputs) count += input.channels.size();
  return count;
}

SafetyChain::SafetyChain(const SafetySettings& settings)
    : settings_(settings),
      inputs_(settings.inputs.size()),
      last_sample_s_(-std::numeric_limits<double>::infinity()) {
  validate(settings_);
}

// A reading may be stamped a little after `now_s`, which the caller took before it asked for the latest one.
bool SafetyChain::is_fresh(const SafetyInputsSnapshot& snapshot, double now_s) const {
  return snapshot.valid && snapshot.count == settings_.channel_count() &&
         std::abs(now_s - snapshot.sampled_at_s) <= settings_.max_age_s &&
         snapshot.sampled_at_s >= last_sample_s_;
}

void SafetyChain::follow(Input& input, const SafetyInputSettings& settings, bool first, bool second,
                         double sampled_at_s) {
  if (first == second) {
    input.differing_since_s.reset();
  } else {
    if (!input.differing_since_s) input.differing_since_s = sampled_at_s;
    if (sampled_at_s - *input.differing_since_s > settings.discrepancy_s)
      input.fault = Input::Fault::kLatched;
  }
  if (!first && !second && input.fault == Input::Fault::kLatched) input.fault = Input::Fault::kSeenOpen;

  if (!(first && second)) {
    input.closed_since_s.reset();
    input.released = false;
    return;
  }
  if (!input.closed_since_s) input.closed_since_s = sampled_at_s;
  const bool steady = sampled_at_s - *input.closed_since_s >= settings.release_s;
  if (steady && input.fault == Input::Fault::kSeenOpen) input.fault = Input::Fault::kNone;
  input.released = steady && input.fault == Input::Fault::kNone;
}

void SafetyChain::latch(StopCategory category, const SafetyVerdict& why, double now_s) {
  if (latched_ == StopCategory::kNone) {
    latched_by_ = why.cause;
    latched_by_input_ = why.input;
    category1_since_s_ = now_s;
    latched_ = category;
  } else if (category == StopCategory::kCategory0) {
    latched_ = category;
  }
}

SafetyVerdict SafetyChain::update(const SafetyInputsSnapshot& snapshot, bool reset_requested, double now_s) {
  SafetyVerdict verdict;
  verdict.cause = SafetyCause::kNone;
  const bool fresh = is_fresh(snapshot, now_s);
  if (fresh) {
    last_sample_s_ = snapshot.sampled_at_s;
  } else {
    verdict.cause = SafetyCause::kNoData;
  }

  StopCategory required = StopCategory::kNone;
  size_t channel = 0;
  for (size_t i = 0; i < inputs_.size(); ++i) {
    Input& input = inputs_[i];
    const SafetyInputSettings& settings = settings_.inputs[i];
    const bool first = snapshot.closed[channel];
    const bool second = snapshot.closed[channel + settings.channels.size() - 1];
    channel += settings.channels.size();
    if (fresh) {
      follow(input, settings, first, second, snapshot.sampled_at_s);
    } else {
      input.closed_since_s.reset();
      input.released = false;
    }
    if (input.released) continue;
    if (required != StopCategory::kCategory0) required = settings.stop;
    const SafetyCause cause =
        input.fault == Input::Fault::kNone ? SafetyCause::kTripped : SafetyCause::kDiscrepancy;
    const bool worse = verdict.cause == SafetyCause::kNone ||
                       (verdict.cause == SafetyCause::kTripped && cause == SafetyCause::kDiscrepancy);
    if (worse) {
      verdict.cause = cause;
      verdict.input = static_cast<int>(i);
    }
  }

  if (required != StopCategory::kNone) latch(required, verdict, now_s);
  // Written so that a time that is no number ends the ramp.
  if (latched_ == StopCategory::kCategory1 && !(now_s - category1_since_s_ <= settings_.ramp_limit_s))
    latched_ = StopCategory::kCategory0;

  const bool edge = reset_requested && !previous_reset_;
  previous_reset_ = reset_requested;
  if (edge && latched_ != StopCategory::kNone) {
    const bool accepted = required == StopCategory::kNone && latched_ == StopCategory::kCategory0;
    verdict.reset = accepted ? SafetyReset::kAccepted : SafetyReset::kRefused;
    if (accepted) latched_ = StopCategory::kNone;
  }

  verdict.stop = latched_;
  verdict.motion_allowed = latched_ == StopCategory::kNone;
  verdict.latched_by = latched_by_;
  verdict.latched_by_input = latched_by_input_;
  if (verdict.cause == SafetyCause::kNone && latched_ == StopCategory::kCategory1)
    verdict.cause = SafetyCause::kStopping;
  if (verdict.cause == SafetyCause::kNone && latched_ == StopCategory::kCategory0)
    verdict.cause = SafetyCause::kResetNeeded;
  return verdict;
}

std::string describe(const SafetyVerdict& verdict, const SafetySettings& settings) {
  const auto name = [&settings](int input) {
    return input >= 0 && static_cast<size_t>(input) < settings.inputs.size()
               ? settings.inputs[static_cast<size_t>(input)].name
               : std::string("an input");
  };
  const auto latched_by = [&]() -> std::string {
    switch (verdict.latched_by) {
      case SafetyCause::kNoData:
        return "the inputs could not be read";
      case SafetyCause::kDiscrepancy:
        return "the channels of " + name(verdict.latched_by_input) + " disagreed";
      case SafetyCause::kTripped:
        return name(verdict.latched_by_input) + " was tripped";
      default:
        return "the program has started";
    }
  };
  switch (verdict.cause) {
    case SafetyCause::kNone:
    case SafetyCause::kStart:
      return "the safety chain is closed";
    case SafetyCause::kNoData:
      return "the safety inputs have not been read for more than " + milliseconds(settings.max_age_s) +
             "; is the I/O module powered and connected?";
    case SafetyCause::kDiscrepancy: {
      const std::string who = name(verdict.input);
      return who +
             ": its two channels disagreed for too long (a broken wire or a stuck contact?); trip and "
             "release " +
             who + " once, so that both channels are seen open, then reset";
    }
    case SafetyCause::kTripped:
      return name(verdict.input) + " is tripped; release it, then reset";
    case SafetyCause::kStopping:
      return "stopping because " + latched_by() + "; reset when the stop has ended";
    case SafetyCause::kResetNeeded:
      return "waiting for a reset because " + latched_by();
  }
  return {};
}

}  // namespace gantry
