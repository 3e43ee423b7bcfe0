#include "random_schedule.h"

#include <cmath>

namespace gantry {
namespace {

constexpr double kRun_s = 40;  ///< About the length of a run that nothing disturbs.
constexpr int kMostFaults = 5;

/// splitmix64: the same numbers everywhere, unlike the standard library's distributions.
class Dice {
 public:
  explicit Dice(uint64_t seed) : state_(seed) {}
  uint64_t next() {
    uint64_t z = state_ += 0x9E3779B97F4A7C15ull;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    return z ^ (z >> 31);
  }
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(next() >> 11) * 0x1p-53;
  }
  size_t pick(size_t count) { return static_cast<size_t>(next() % count); }
  bool chance(double p) { return between(0, 1) < p; }

 private:
  uint64_t state_;
};

bool can_be(const FaultModeInfo& mode, const FaultTargetNames& names) {
  return mode.device == FaultDevice::kCamera || (mode.device == FaultDevice::kAxis && !names.axes.empty()) ||
         (mode.device == FaultDevice::kBus && !names.buses.empty()) ||
         (mode.device == FaultDevice::kSafety && !names.safety.empty());
}

FaultEntry random_entry(Dice& dice, const FaultTargetNames& names) {
  FaultEntry e;
  const FaultModeInfo* mode = nullptr;
  do mode = &fault_modes()[dice.pick(fault_modes().size())];
  while (!can_be(*mode, names));
  e.device = mode->device;
  e.mode = mode->mode;
  if (dice.chance(0.25)) {
    e.event = dice.chance(0.5) ? FaultEvent::kMotion : FaultEvent::kExposure;
    e.event_count = 1 + static_cast<int>(dice.pick(*e.event == FaultEvent::kMotion ? 7 : 3));
    e.at_s = dice.between(0, *e.event == FaultEvent::kMotion ? 1.0 : 0.12);
  } else {
    e.at_s = dice.between(0, kRun_s);
  }
  // From a moment to long enough for every time limit of the controller.
  if (mode->lasts) e.for_s = std::pow(10.0, dice.between(-1.7, 0.9));
  if (e.device == FaultDevice::kAxis) {
    const auto& axis = names.axes[dice.pick(names.axes.size())];
    e.name = axis.name;
    if (e.mode == FaultMode::kSlip) e.distance = dice.between(-1, 1) * (axis.rotary ? 0.02 : 3.0);
    if (e.mode == FaultMode::kRunaway) e.upwards = dice.chance(0.5);
    if (e.mode == FaultMode::kAlarm) e.code = 1 + static_cast<int>(dice.pick(255));
  } else if (e.device == FaultDevice::kBus) {
    e.name = names.buses[dice.pick(names.buses.size())];
    if (e.mode != FaultMode::kDisconnect)
      e.probability = dice.chance(0.5) ? 1 : std::pow(10.0, dice.between(-3, 0));
    if (e.mode == FaultMode::kDelayReply) e.delay_s = dice.between(0, 1);
  } else if (e.device == FaultDevice::kSafety) {
    const auto& input = names.safety[dice.pick(names.safety.size())];
    e.name = input.name;
    if (e.mode == FaultMode::kPress && dice.chance(0.3)) e.lag_s = dice.between(0, 0.8);
    if (e.mode == FaultMode::kWireBreak || e.mode == FaultMode::kStickContact)
      e.contact = static_cast<int>(dice.pick(static_cast<size_t>(input.contacts)));
  }
  return e;
}

}  // namespace

FaultSchedule random_schedule(uint64_t seed, const FaultTargetNames& names) {
  Dice dice(seed);
  FaultSchedule schedule;
  schedule.seed = seed;
  const size_t count = 1 + dice.pick(kMostFaults);
  for (size_t k = 0; k < count; ++k) schedule.entries.push_back(random_entry(dice, names));
  return schedule;
}

uint64_t schedule_seed(uint64_t campaign_seed, uint64_t k) {
  Dice dice(campaign_seed * 0x100000001B3ull + k);
  return dice.next() >> 11;
}

}  // namespace gantry
