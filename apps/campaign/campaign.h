#pragma once

#include <map>
#include <string>
#include <vector>

#include "play.h"

namespace gantry {

struct CampaignOptions {
  uint64_t schedules = 200;
  double hours = 0;  ///< Simulated hours instead of a number of schedules; 0: the number counts.
  uint64_t seed = 1;
};

/// How often a kind of fault was played, and what the controller made of it.
struct KindCount {
  int played = 0;
  std::map<std::string, int> reactions;  ///< "none": the run went on.
};

struct CampaignFailure {
  uint64_t index = 0;    ///< Of the schedule in the campaign.
  FaultSchedule shrunk;  ///< Fails in the same way.
  Violation violation;   ///< Of the shrunk one.
};

struct CampaignResult {
  uint64_t schedules = 0;
  double simulated_s = 0;
  uint64_t attempts = 0, scans = 0, slipped_scans = 0;
  std::map<std::string, KindCount> kinds;  ///< By "axis stuck", ...
  uint64_t failed = 0;                     ///< Schedules that broke a rule.
  std::vector<CampaignFailure> failures;   ///< The first of each invariant, shrunk.
};

/// Plays random schedules, on as many threads as TBB may use; the result does not depend on their number.
CampaignResult run_campaign(const CampaignCell& setup, const CampaignOptions& options,
                            const CampaignHooks& hooks = {});

}  // namespace gantry
