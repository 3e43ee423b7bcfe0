#include "experiment.h"

#include <tbb/parallel_for.h>

#include <cmath>

namespace gantry::bench {
namespace {

double deviation(const DistanceResult& result) {
  if (result.metric == Metric::kChamferSquared)
    return result.value / (kMetre_mm * kMetre_mm) - 2 * kShift_m * kShift_m;
  return result.value / kMetre_mm - kShift_m;
}

Deviation over_runs(const std::vector<std::vector<double>>& runs, size_t metric) {
  Deviation d;
  const auto n = static_cast<double>(runs.size());
  for (const auto& run : runs) d.mean += run[metric] / n;
  for (const auto& run : runs) d.spread += std::pow(run[metric] - d.mean, 2) / std::max(1.0, n - 1);
  d.spread = std::sqrt(d.spread);
  return d;
}

}  // namespace

std::map<Metric, Deviation> run_condition(const Condition& condition, const ExperimentOptions& options) {
  const TriangleMesh mesh = shape_mesh(condition.shape);
  std::vector<std::vector<double>> runs(options.runs);
  tbb::parallel_for(size_t{0}, options.runs, [&](size_t run) {
    const DistanceReference reference(mesh, options.points, 1 + run);
    const PointCloud copy = perturbed_copy(reference.cloud(), condition.perturbation, 1'000'001 + run);
    for (const DistanceResult& result : compare(copy, reference, options.metrics))
      runs[run].push_back(deviation(result));
  });
  std::map<Metric, Deviation> found;
  for (size_t m = 0; m < options.metrics.size(); ++m) found[options.metrics[m]] = over_runs(runs, m);
  return found;
}

}  // namespace gantry::bench
