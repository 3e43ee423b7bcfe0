#pragma once

#include <vector>

#include "gantry/sim/stage.h"

namespace gantry {

/// The ramps of a homing from rest at `from`, one after the other from `begin_s` on, and how it will end.
struct HomingProgram {
  std::vector<StageRamp> ramps;
  HomingFailure outcome = HomingFailure::kNone;
};

/// Whether the home switch is active with the carriage at `position`.
bool on_home_switch(const StageDynamics& dynamics, double position);

HomingProgram plan_homing(const StageDynamics& dynamics, bool switch_works, double from, double begin_s);

}  // namespace gantry
