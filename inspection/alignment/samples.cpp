#include "alignment/samples.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "gantry/geometry/point_index.h"
#include "gantry/geometry/spatial_order.h"

namespace gantry::internal {
namespace {

constexpr size_t kNeighbours = 16;

std::vector<std::vector<uint32_t>> neighbours_of(const std::vector<Eigen::Vector3f>& points) {
  std::vector<std::vector<uint32_t>> near(points.size());
  if (points.empty()) return near;
  const PointIndex index(points);
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) {
    thread_local std::vector<PointIndex::Neighbour> found;
    index.nearest(points[i], kNeighbours + 1, std::numeric_limits<float>::infinity(), found);
    for (const auto& n : found)
      if (n.index != i) near[i].push_back(n.index);
  });
  std::vector<std::vector<uint32_t>> both = near;
  for (uint32_t i = 0; i < near.size(); ++i)
    for (const uint32_t j : near[i])
      if (std::find(near[j].begin(), near[j].end(), i) == near[j].end()) both[j].push_back(i);
  return both;
}

}  // namespace

std::vector<double> sample_weights(const PointCloud& cloud) {
  std::vector<double> weight(cloud.size(), 1.0);
  std::vector<float> sorted = cloud.sigma_mm;
  std::sort(sorted.begin(), sorted.end());
  const double median = sorted.empty() ? 0 : sorted[sorted.size() / 2];
  if (!cloud.has_sigma() || !(median > 0)) return weight;
  for (size_t i = 0; i < weight.size(); ++i) {
    const double ratio = std::clamp(cloud.sigma_mm[i] / median, 0.25, 4.0);
    weight[i] = 1 / (ratio * ratio);
  }
  return weight;
}

AlignmentSamples choose_samples(const PointCloud& cloud, size_t count) {
  AlignmentSamples samples;
  const std::vector<uint32_t> order = morton_order(cloud.points);
  std::vector<uint32_t> chosen(std::min(count, order.size()));
  for (size_t s = 0; s < chosen.size(); ++s) chosen[s] = order[s * order.size() / chosen.size()];
  samples.cloud = select(cloud, chosen);
  samples.weight = sample_weights(samples.cloud);
  samples.neighbours = neighbours_of(samples.cloud.points);
  return samples;
}

void find_pairs(const PointCloud& samples, const SignedDistance& model, const Pose& cad_from_cloud,
                double reach_mm, double min_cosine, std::vector<Pair>& pairs) {
  pairs.resize(samples.size());
  tbb::parallel_for(size_t{0}, pairs.size(), [&](size_t i) {
    Pair& pair = pairs[i];
    pair.point = cad_from_cloud * samples.points[i].cast<double>();
    const Eigen::Vector3f p = pair.point.cast<float>();
    const auto reach = static_cast<float>(reach_mm);
    std::optional<SignedDistance::Value> value;
    if (samples.has_normals()) {
      value = model(p, (cad_from_cloud.linear() * samples.normals[i].cast<double>()).cast<float>(),
                    static_cast<float>(min_cosine), reach, pair.triangle);
    } else {
      value = model(p, reach, pair.triangle);
    }
    pair.found = value.has_value();
    if (!value) return;
    pair.triangle = value->triangle;
    // The plane of the closest face, not the edge's pseudonormal: a slide along it must cost nothing.
    pair.normal = model.mesh().normal(static_cast<size_t>(value->triangle)).cast<double>();
    pair.distance = pair.normal.dot(pair.point - value->closest.cast<double>());
  });
}

FitFrame frame_of(const std::vector<Eigen::Vector3d>& points) {
  FitFrame frame;
  if (points.empty()) return frame;
  const auto n = static_cast<double>(points.size());
  for (const auto& p : points) frame.centre += p / n;
  double squares = 0;
  for (const auto& p : points) squares += (p - frame.centre).squaredNorm() / n;
  frame.lever_mm = std::max(std::sqrt(squares), 1e-3);
  return frame;
}

double robust_sigma(std::vector<double> values) {
  if (values.empty()) return 0;
  for (double& v : values) v = std::abs(v);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return 1.4826 * *middle;
}

}  // namespace gantry::internal
