#pragma once

#include <Eigen/Core>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// The arithmetic of matching one block of pixels, laid out in arrays so that the compiler can use the
/// machine's vector unit: this is where registration spends its time.
struct MatchKernel {
  static constexpr int kMost = 256;  ///< Pixels of a block.

  // Set once for a pair of scans.
  bool source_central, target_central;
  bool source_distorted, target_distorted;
  float rotation[9], shift[3];   ///< target_from_source, row-major.
  float to_ray[6], to_pixel[6];  ///< Linear parts of the maps: of (1, column, row) and (1, u, v).
  float last_column, last_row;
  float centre[3];  ///< Of the part, in the target's frame.
  float cosine, reach, scale_squared;

  /// Source pixels of a block that hold data.
  struct Pixels {
    int count = 0;
    alignas(64) float column[kMost], row[kMost], w[kMost], a[kMost], b[kMost];
    alignas(64) float u[kMost], v[kMost];  ///< Their rays; filled by the caller when distorted.
  };
  /// Where they fall in the target.
  struct Falls {
    alignas(64) float px[kMost], py[kMost], pz[kMost], nx[kMost], ny[kMost], nz[kMost];
    alignas(64) float u[kMost], v[kMost], w[kMost], column[kMost], row[kMost];
    alignas(64) float facing[kMost];  ///< 1: in front of the target's sensor and facing it.
  };
  /// Those that fell on its surface: point, normal, depth, and what the target has there.
  struct Pairs {
    int count = 0;
    alignas(64) float px[kMost], py[kMost], pz[kMost], nx[kMost], ny[kMost], nz[kMost], w[kMost];
    alignas(64) float q_w[kMost], a[kMost], b[kMost];
  };
  /// Sums over the matches: see PairSum; `squares` is the upper triangle of sum w arm arm^T.
  struct Sums {
    float hessian[21], gradient[6], arms[3], squares[6], place[3];
    float weight, stiffness, cost, matches;
  };

  void project(Pixels& pixels, Falls& falls) const;
  void sum(const Pairs& pairs, Sums& sums) const;
};

}  // namespace gantry::internal
