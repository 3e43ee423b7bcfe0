#pragma once

#include <string>
#include <vector>

#include "alignment/normal_equations.h"
#include "gantry/inspection/alignment.h"

namespace gantry::internal {

/// "x", "-y", or "(0.71, 0.00, 0.71)" for a unit vector that is along no axis to within a degree.
std::string direction_words(const Eigen::Vector3d& direction);

/// A basis of the free motions, slides first, each as simple as can be: a turn goes through the point of its
/// axis nearest to the frame's centre and slides only when it must (a thread).
std::vector<FreeMotion> name_free_motions(const HeldMotions& motions, const FitFrame& frame);

/// "turned by 180 degrees about z"; through which point is not said. "moved" for a shift only.
std::string rotation_words(const Eigen::Matrix3d& rotation);

}  // namespace gantry::internal
