#pragma once

#include <string>
#include <vector>

#include "joint/problem.h"

namespace gantry::internal {

/// What speaks for or against one scan's place.
struct ScanEvidence {
  Agreement agreement;    ///< With all others, both ways.
  double violation = 0;   ///< Fraction in front of, or through, what others saw.
  double background = 0;  ///< Fraction where others saw nothing.
  bool connected = true;  ///< Shares surface with scan 0, directly or through others.
};

struct Evidence {
  std::vector<ScanEvidence> scans;
  Pairs pairs;                        ///< That share surface.
  std::vector<Agreement> agreements;  ///< Of pairs[k]: (first as target) at 2k, the other way at 2k + 1.
  double worst_violation = 0;
  double worst_background = 0;
  bool all_connected = true;
  double score = 0;  ///< Larger is better: matched minus violated, over all.
};

/// Looks at all pairs of scans at these poses.
Evidence gather_evidence(const JointProblem& problem, const Poses& poses, double sigma_mm);

/// The wobble test: pushes the result 2 mm (at the part's radius) along its two weakest directions, lets it
/// converge again, and returns how far it ends from where it was. A result that stands in a wide, wrong or
/// sliding basin does not come back. `weakest` (optional): the direction that came back least.
double wobble_mm(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                 Eigen::VectorXd* weakest = nullptr);

}  // namespace gantry::internal
