#pragma once

#include <string>
#include <vector>

#include "joint/problem.h"

namespace gantry::internal {

/// What speaks for or against one scan's place.
struct ScanEvidence {
  Agreement agreement;    ///< With all others, both ways.
  double violation = 0;   ///< Fraction in front of, or through, what others saw.
  bool connected = true;  ///< Shares surface with scan 0, directly or through others.
};

struct Evidence {
  std::vector<ScanEvidence> scans;
  Pairs pairs;              ///< That share surface and take part.
  Pairs pairs_of_left_out;  ///< That share surface; one of the two scans takes part, the other is left out.
  double worst_violation = 0;  ///< Of the scans that take part.

  Pairs all_pairs;                    ///< That share surface, whether they take part or not.
  std::vector<Agreement> agreements;  ///< Of every target and source: [target * scans.size() + source].

  /// Both ways of a pair.
  Agreement agreement_of(size_t a, size_t b) const;
  /// Counts again as if these scans (by index) were not there; what is said of them themselves is against
  /// those that take part.
  void leave_out(const std::vector<bool>& scans_left_out);
};

/// Looks at all pairs of scans at these poses.
Evidence gather_evidence(const JointProblem& problem, const Poses& poses, double sigma_mm);

/// The wobble test: pushes the result 2 mm (at the part's radius) along its two weakest directions, lets it
/// converge again, and returns how far it ends from where it was. A result that stands in a wide, wrong or
/// sliding basin does not come back. Scans in none of the pairs take no part.
struct Wobble {
  double worst_mm = 0;
  Eigen::VectorXd weakest;       ///< The direction that came back least, 6 rows a scan.
  std::vector<double> scans_mm;  ///< Of each scan against where most of them came to rest.
};
Wobble wobble(const JointProblem& problem, const Pairs& pairs, const Poses& poses);

}  // namespace gantry::internal
