#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "gantry/acquisition/safety_chain.h"

namespace gantry::testing {

/// What the safety chain is given in one cycle.
struct SafetyStep {
  SafetyInputsSnapshot snapshot;
  bool reset = false;
  double now_s = 0;
};

/// The safety chain said again, in another way: not as a machine with a memory but as statements about the
/// whole history of what was read, answered anew in every cycle by looking back. Slow, and meant to be
/// obvious.
class SafetyOracle {
 public:
  explicit SafetyOracle(SafetySettings settings) : settings_(std::move(settings)) {}

  struct Answer {
    StopCategory stop = StopCategory::kCategory0;
    SafetyReset reset = SafetyReset::kNone;
    std::vector<bool> released, faulty;
    bool fresh = false;
  };

  Answer after(const SafetyStep& step) {
    steps_.push_back(step);
    const size_t n = steps_.size() - 1;
    Answer answer;
    answer.fresh = fresh(n);
    bool all_released = true;
    for (size_t i = 0; i < settings_.inputs.size(); ++i) {
      answer.faulty.push_back(faulty(i, n));
      answer.released.push_back(released(i, n));
      all_released = all_released && answer.released.back();
    }
    demanded_.push_back(StopCategory::kNone);
    for (size_t i = 0; i < settings_.inputs.size(); ++i)
      if (!answer.released[i] && demanded_[n] != StopCategory::kCategory0)
        demanded_[n] = settings_.inputs[i].stop;

    // Before this cycle's reset: the highest demand since the last accepted reset.
    StopCategory stop = stop_since(n);
    const bool edge = n > 0 && step.reset && !steps_[n - 1].reset;
    if (edge && stop != StopCategory::kNone) {
      const bool accepted = all_released && stop == StopCategory::kCategory0;
      answer.reset = accepted ? SafetyReset::kAccepted : SafetyReset::kRefused;
      if (accepted) {
        last_reset_ = static_cast<int>(n);
        stop = StopCategory::kNone;
      }
    }
    answer.stop = stop;
    return answer;
  }

 private:
  bool closed(size_t input, size_t contact, size_t n) const {
    size_t channel = 0;
    for (size_t i = 0; i < input; ++i) channel += settings_.inputs[i].channels.size();
    return steps_[n]
        .snapshot.closed[channel + std::min(contact, settings_.inputs[input].channels.size() - 1)];
  }
  bool both(size_t i, size_t n, bool level) const {
    return closed(i, 0, n) == level && closed(i, 1, n) == level;
  }
  bool differ(size_t i, size_t n) const { return closed(i, 0, n) != closed(i, 1, n); }
  double time(size_t n) const { return steps_[n].snapshot.sampled_at_s; }

  bool fresh(size_t n) const {
    const SafetyInputsSnapshot& s = steps_[n].snapshot;
    const double age_s = steps_[n].now_s - s.sampled_at_s;
    if (!s.valid || s.count != settings_.channel_count()) return false;
    if (!(age_s <= settings_.max_age_s && -age_s <= settings_.max_age_s)) return false;
    for (size_t m = 0; m < n; ++m)
      if (was_fresh(m) && time(m) > time(n)) return false;  // time went backwards
    return note(n);
  }
  bool note(size_t n) const {
    fresh_.resize(std::max(fresh_.size(), n + 1), false);
    fresh_[n] = true;
    return true;
  }
  bool was_fresh(size_t n) const { return n < fresh_.size() && fresh_[n]; }

  /// Whether reading n ends a stretch of disagreement (of fresh readings) that is longer than allowed.
  bool disagrees_too_long(size_t i, size_t n) const {
    if (!was_fresh(n) || !differ(i, n)) return false;
    for (size_t m = n + 1; m-- > 0;) {
      if (!was_fresh(m)) continue;
      if (!differ(i, m)) return false;
      if (time(n) - time(m) > settings_.inputs[i].discrepancy_s) return true;
    }
    return false;
  }

  /// Read closed at n and, without anything else or any gap between, for the release time before.
  bool steady(size_t i, size_t n) const {
    for (size_t m = n + 1; m-- > 0;) {
      if (!was_fresh(m) || !both(i, m, true)) return false;
      if (time(n) - time(m) >= settings_.inputs[i].release_s) return true;
    }
    return false;
  }

  /// A disagreement too long, after which the input was not seen open in both channels and then steadily
  /// closed.
  bool faulty(size_t i, size_t n) const {
    bool result = false;
    for (size_t m = 0; m <= n; ++m) {
      if (!disagrees_too_long(i, m)) continue;
      bool proved = false;
      for (size_t open = m + 1; open <= n && !proved; ++open)
        for (size_t shut = open + 1; shut <= n && !proved; ++shut)
          proved = was_fresh(open) && both(i, open, false) && steady(i, shut);
      result = result || !proved;
    }
    return result;
  }

  bool released(size_t i, size_t n) const { return was_fresh(n) && steady(i, n) && !faulty(i, n); }

  StopCategory stop_since(size_t n) const {
    if (last_reset_ < 0) return StopCategory::kCategory0;  // the program's start
    const size_t begin = static_cast<size_t>(last_reset_) + 1;
    StopCategory stop = StopCategory::kNone;
    double since_s = 0;
    for (size_t m = begin; m <= n; ++m) {
      if (demanded_[m] == StopCategory::kCategory0) return StopCategory::kCategory0;
      if (demanded_[m] == StopCategory::kCategory1 && stop == StopCategory::kNone) {
        stop = StopCategory::kCategory1;
        since_s = steps_[m].now_s;
      }
      if (stop == StopCategory::kCategory1 && steps_[m].now_s - since_s > settings_.ramp_limit_s)
        return StopCategory::kCategory0;
    }
    return stop;
  }

  SafetySettings settings_;
  std::vector<SafetyStep> steps_;
  mutable std::vector<bool> fresh_;
  std::vector<StopCategory> demanded_;
  int last_reset_ = -1;
};

}  // namespace gantry::testing
