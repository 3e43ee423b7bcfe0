#pragma once

#include <vector>

#include "joint/problem.h"

namespace gantry::internal {

/// How scans agree by a tolerance that coarse alignment reaches, and with their tags.
struct Fit {
  size_t matched = 0, violated = 0, background = 0;  ///< Samples; see Agreement.
  /// Of the matches, counted less the more a pair has: samples of a pair say much the same, and to lie on top
  /// of each other is no merit.
  double support = 0;
  double from_tag = 0;  ///< Chi-square of the distance to the tagged pose, as far as it says anything.

  Fit& operator+=(const Fit& o);
  double violation() const;
  double score() const;
};

/// Samples of each of two scans that a fit is made of, about.
constexpr size_t kFitSamples = 1500;

/// Agreement of two scans, both ways.
Fit fit_of_pair(const JointProblem& problem, size_t a, size_t b, const Pose& pose_a, const Pose& pose_b,
                double tolerance_mm);

/// Scans that are taken to be in place.
struct Core {
  std::vector<size_t> scans;
  Poses poses;  ///< Of all scans, by index; those outside the core are only starts.

  bool holds(size_t scan) const;
};

struct Start {
  Pose pose;
  double error_mm;  ///< How wrong it may be.
};

struct Placement {
  Pose pose = Pose::Identity();
  Fit fit;
};

/// The scan's tag as seen from the core, which may have moved as a whole since it was tagged.
Pose tag_seen_from(const JointProblem& problem, const Core& core, size_t scan);

/// Chi-square of a pose against that tag, as far as it says anything.
double from_tag(const JointProblem& problem, const Core& core, size_t scan, const Pose& pose);

/// That tag, where the scan is now, and turned about the part's centre by up to `widest_rad`.
std::vector<Start> starts_near_tag(const JointProblem& problem, const Core& core, size_t scan,
                                   double widest_rad);

/// What surface features propose (global_initialisation.h).
std::vector<Start> starts_from_features(const JointProblem& problem, const Core& core, size_t scan);

/// Aligns the scan to the core from every start: the `most` best that differ, best first.
std::vector<Placement> placements(const JointProblem& problem, const Core& core, size_t scan,
                                  const std::vector<Start>& starts, size_t most);

/// The `most` of greatest score that differ, best first.
std::vector<Placement> best_distinct(const JointProblem& problem, std::vector<Placement> found, size_t most);

}  // namespace gantry::internal
