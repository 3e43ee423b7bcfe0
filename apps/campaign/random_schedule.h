#pragma once

#include "gantry/sim/fault_schedule.h"

namespace gantry {

/// A schedule of one to five faults of any kind on what `names` lists, within the time that a short run
/// takes. The same seed gives the same schedule.
FaultSchedule random_schedule(uint64_t seed, const FaultTargetNames& names);

/// The seed of the k-th schedule of a campaign; at most 53 bits, so that a file holds it exactly.
uint64_t schedule_seed(uint64_t campaign_seed, uint64_t k);

}  // namespace gantry
