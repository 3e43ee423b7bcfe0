#include "gantry/sim/fault_player.h"

#include <algorithm>

namespace gantry {

FaultPlayer::FaultPlayer(FaultSchedule schedule, FaultTarget& target)
    : schedule_(std::move(schedule)), target_(target), states_(schedule_.entries.size()) {
  for (size_t i = 0; i < states_.size(); ++i)
    if (!schedule_.entries[i].event) states_[i].due_s = schedule_.entries[i].at_s;
}

std::optional<double> FaultPlayer::next_s() const {
  std::optional<double> next;
  for (const State& state : states_)
    if (state.due_s && (!next || *state.due_s < *next)) next = state.due_s;
  return next;
}

void FaultPlayer::advance(double now_s) {
  while (const auto next = next_s()) {
    if (*next > now_s) return;
    const auto due =
        std::find_if(states_.begin(), states_.end(), [&](const State& s) { return s.due_s == next; });
    const auto entry = static_cast<size_t>(due - states_.begin());
    if (due->phase == State::kWaiting) {
      begin(entry, now_s);
    } else {
      end(entry, now_s);
    }
  }
}

void FaultPlayer::notify(FaultEvent event, double now_s) {
  const int count = ++(event == FaultEvent::kMotion ? motions_ : exposures_);
  for (size_t i = 0; i < states_.size(); ++i) {
    const FaultEntry& entry = schedule_.entries[i];
    if (states_[i].phase == State::kWaiting && entry.event == event && entry.event_count == count)
      states_[i].due_s = now_s + entry.at_s;
  }
  advance(now_s);
}

void FaultPlayer::begin(size_t i, double now_s) {
  const FaultEntry& entry = schedule_.entries[i];
  const bool lasts = entry.mode != FaultMode::kSlip;
  states_[i].phase = lasts ? State::kActive : State::kOver;
  states_[i].due_s.reset();
  if (lasts) states_[i].due_s = now_s + entry.for_s;
  target_.begin(entry, now_s);
  if (observer_) observer_(i, Phase::kBegin, now_s);
}

void FaultPlayer::end(size_t i, double now_s) {
  states_[i] = {State::kOver, std::nullopt};
  const FaultEntry& ended = schedule_.entries[i];
  target_.end(ended, now_s);
  // Repairing a device repairs all of it: what else is still wrong with it begins anew.
  for (size_t k = 0; k < states_.size(); ++k) {
    const FaultEntry& other = schedule_.entries[k];
    if (active(k) && other.device == ended.device && other.name == ended.name &&
        (other.mode == ended.mode || other.device == FaultDevice::kSafety))
      target_.begin(other, now_s);
  }
  if (observer_) observer_(i, Phase::kEnd, now_s);
}

bool FaultPlayer::any_active() const {
  return std::any_of(states_.begin(), states_.end(),
                     [](const State& state) { return state.phase == State::kActive; });
}

bool FaultPlayer::quiet() const {
  return !next_s();
}

}  // namespace gantry
