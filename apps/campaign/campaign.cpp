#include "campaign.h"

#include <tbb/parallel_for.h>

#include <set>

#include "random_schedule.h"
#include "shrink.h"

namespace gantry {
namespace {

constexpr uint64_t kBatch = 64;  ///< Fixed, so that --hours ends at the same schedule on every machine.

void count(const FaultSchedule& schedule, const PlayResult& played, CampaignResult& result) {
  ++result.schedules;
  result.simulated_s += played.simulated_s;
  result.attempts += static_cast<uint64_t>(played.attempts);
  result.scans += static_cast<uint64_t>(played.scans);
  result.slipped_scans += static_cast<uint64_t>(played.slipped_scans);
  for (size_t k = 0; k < schedule.entries.size(); ++k) {
    if (!played.faults[k].played) continue;
    const FaultEntry& entry = schedule.entries[k];
    KindCount& kind =
        result.kinds[std::string(to_string(entry.device)) + " " + std::string(to_string(entry.mode))];
    ++kind.played;
    ++kind.reactions[played.faults[k].reaction.empty() ? "none" : played.faults[k].reaction];
  }
}

CampaignFailure shrunk(const CampaignCell& setup, const CampaignHooks& hooks, uint64_t index,
                       const FaultSchedule& schedule, const Violation& violation) {
  CampaignFailure failure{index, schedule, violation};
  failure.shrunk = shrink(schedule, [&](const FaultSchedule& candidate) {
    const auto played = play(setup, candidate, hooks);
    return played.violation && played.violation->invariant == violation.invariant;
  });
  failure.violation = *play(setup, failure.shrunk, hooks).violation;
  return failure;
}

}  // namespace

CampaignResult run_campaign(const CampaignCell& setup, const CampaignOptions& options,
                            const CampaignHooks& hooks) {
  const FaultTargetNames names = fault_targets(setup.cell);
  CampaignResult result;
  std::set<std::string> broken;
  const auto more = [&] {
    return options.hours > 0 ? result.simulated_s < options.hours * 3600
                             : result.schedules < options.schedules;
  };
  while (more()) {
    const uint64_t first = result.schedules;
    const uint64_t batch = options.hours > 0 ? kBatch : std::min(kBatch, options.schedules - first);
    std::vector<FaultSchedule> schedules(batch);
    std::vector<PlayResult> played(batch);
    tbb::parallel_for(uint64_t{0}, batch, [&](uint64_t k) {
      schedules[k] = random_schedule(schedule_seed(options.seed, first + k), names);
      played[k] = play(setup, schedules[k], hooks);
    });
    for (uint64_t k = 0; k < batch; ++k) {
      count(schedules[k], played[k], result);
      if (!played[k].violation) continue;
      ++result.failed;
      if (!broken.insert(played[k].violation->invariant).second) continue;
      result.failures.push_back(shrunk(setup, hooks, first + k, schedules[k], *played[k].violation));
    }
  }
  return result;
}

}  // namespace gantry
