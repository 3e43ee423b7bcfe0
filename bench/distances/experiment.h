#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "gantry/inspection/distances.h"
#include "shapes.h"

namespace gantry::bench {

/// Over the runs, of metric - truth; metres, for kChamferSquared square metres. The truth is the shift, for
/// kChamferSquared twice its square: with a shift of 0.5 m the same number.
struct Deviation {
  double mean = 0;
  double spread = 0;  ///< Standard deviation over the runs.
};

struct Condition {
  Shape shape = Shape::kPlane;
  Perturbation perturbation;
};

struct ExperimentOptions {
  size_t runs = 100;
  size_t points = 1000;
  std::vector<Metric> metrics;
};

/// All runs of one condition, by metric. Run number i draws its points with seed i, whatever the condition.
std::map<Metric, Deviation> run_condition(const Condition& condition, const ExperimentOptions& options);

}  // namespace gantry::bench
