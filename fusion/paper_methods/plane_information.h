#pragma once

#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// A point where two surfaces were found to touch, each with its own estimate of the common normal.
struct PlaneContact {
  Eigen::Vector3d point;
  Eigen::Vector3d normal_a, normal_b;
  double weight = 0;  ///< 1 / variance (mm^-2) of the distance along the normal.
};

/// Information about the relative motion exp(e) that the distances along the normals hold: the sum of
/// weight * J^T J with J = [(p x n)^T, n^T].
///
/// Measured normals are noisy, and the sum of n n^T over noisy normals claims to know the motion *along* a
/// plane: 2 degrees of noise and 10^5 points claim it to a hundredth of a millimetre. The two surfaces'
/// normals err independently, so the mixed product J_a^T J_b has no such bias. What the two differ by,
/// (J_a - J_b)^T (J_a - J_b) / 2, tells how much of it was noise; a fiftieth of that is taken off besides,
/// for what chance may leave, and directions with nothing left get exactly zero: a flat overlap has three.
Matrix6d plane_information(const std::vector<PlaneContact>& contacts);

}  // namespace gantry
