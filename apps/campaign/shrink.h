#pragma once

#include <functional>

#include "gantry/sim/fault_schedule.h"

namespace gantry {

/// Whether a schedule still breaks what is being looked at.
using StillFails = std::function<bool(const FaultSchedule&)>;

/// The smallest schedule found that still fails: first without every entry that is not needed (delta
/// debugging, Zeller and Hildebrandt 2002), then with shorter faults and rounder times. `schedule` itself
/// must fail. Asks at most `budget` times.
FaultSchedule shrink(const FaultSchedule& schedule, const StillFails& still_fails, int budget = 400);

}  // namespace gantry
