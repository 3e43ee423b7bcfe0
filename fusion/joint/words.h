#pragma once

#include <string>

#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// How a pose with this covariance (errors about `centre`, part frame) could be wrong, as a person reads it:
/// the directions in which its standard uncertainty exceeds `limit_mm` at `radius_mm` from the centre, such
/// as "slides 0.21 mm along (1.00, 0.02, 0.00)" or "turns 0.35 deg about (0.00, 0.00, 1.00)". Otherwise
/// "fixed within 0.004 mm and 0.003 deg".
std::string observability_in_words(const Matrix6d& covariance, double radius_mm, double limit_mm);

/// A motion about the part's centre in the same words, without numbers: "sliding along (...)".
std::string motion_in_words(const Vector6d& motion, double radius_mm);

/// printf into a string.
std::string text(const char* format, ...) __attribute__((format(printf, 1, 2)));

}  // namespace gantry::internal
