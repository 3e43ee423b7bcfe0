#pragma once

#include <optional>
#include <string>
#include <vector>

#include "campaign_rig.h"
#include "invariants.h"

namespace gantry {

/// What became of one fault of a schedule.
struct PlayedFault {
  bool played = false;   ///< Its time or event came before the run was done.
  std::string reaction;  ///< How the controller reacted: "following error", "safety", ...; empty: not at all.
};

struct PlayResult {
  std::optional<Violation> violation;
  std::vector<PlayedFault> faults;  ///< One for each entry.
  std::vector<std::string> story;  ///< What happened, a line each: "12.30 s  axis tilt: stuck begins".
  double simulated_s = 0;
  int attempts = 0;  ///< Resets, homings and resumed runs until the plan was done.
  int scans = 0;
  int slipped_scans = 0;  ///< Scans tagged by an encoder that had slipped: nothing in the cell can know.
};

/// Plays a schedule against a run of a short plan in the cell: connect, reset, home, run; after a failure
/// again, as docs/motion.md says, until the plan is done. Deterministic. The run is kept in a temporary
/// folder. Throws InputError only for a temporary folder that cannot be written.
PlayResult play(const CampaignCell& setup, const FaultSchedule& schedule, const CampaignHooks& hooks = {});

}  // namespace gantry
