#include "gantry/fusion/fusion.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <numeric>

#include "gantry/foundation/error.h"
#include "gantry/fusion/overlap.h"

namespace gantry {
namespace {

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

Eigen::Vector3d centroid(const ScanSurface& surface) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& p : surface.cloud.points) sum += p.cast<double>();
  return sum / static_cast<double>(surface.cloud.size());
}

/// How far (mm, one sigma) the tagged poses leave two scans apart, at the source's centre.
double relative_sigma_mm(const ScanSurface& a, const ScanSurface& b) {
  const Eigen::Vector3d centre = b.part_from_sensor.mean * centroid(b);
  return point_sigma_mm(a.part_from_sensor.covariance() + b.part_from_sensor.covariance(), centre);
}

/// Point-to-plane distances from samples of one surface to another, both in the part frame.
void collect_residuals(const GicpTarget& target, const Pose& part_from_target, const ScanSurface& source,
                       const Pose& part_from_source, std::vector<float>& out) {
  const Pose target_from_source = part_from_target.inverse() * part_from_source;
  const size_t stride = std::max<size_t>(1, source.cloud.size() / 5000);
  const size_t count = (source.cloud.size() + stride - 1) / stride;
  std::vector<float> found(count, -1);
  tbb::parallel_for(size_t{0}, count, [&](size_t s) {
    thread_local std::vector<PointIndex::Neighbour> nearest;
    const size_t i = s * stride;
    const Eigen::Vector3f p = (target_from_source * source.cloud.points[i].cast<double>()).cast<float>();
    const Eigen::Vector3f n =
        (target_from_source.linear() * source.cloud.normals[i].cast<double>()).cast<float>();
    target.index().nearest(p, 1, 2.0f, nearest);
    if (nearest.empty()) return;
    const uint32_t j = nearest[0].index;
    const ScanSurface& to = target.surface();
    if (to.rim[j] || to.cloud.normals[j].dot(n) < 0.7071f) return;
    found[s] = std::abs(to.cloud.normals[j].dot(p - to.cloud.points[j]));
  });
  for (float value : found)
    if (value >= 0) out.push_back(value);
}

double trimmed_rms(std::vector<float> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  values.resize(std::max<size_t>(1, values.size() * 9 / 10));
  double squares = 0;
  for (float v : values) squares += static_cast<double>(v) * v;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

}  // namespace

struct Fusion::Impl {
  FusionOptions options;
  std::deque<ScanSurface> surfaces;  // a deque: targets hold references
  std::deque<GicpTarget> targets;
  std::vector<PoseGraphEdge> edges;
  double preprocess_s = 0, pairs_s = 0;

  void match_with_earlier(size_t source);
  OverlapResidual overlap_residual(const std::vector<Pose>& poses, std::vector<double>* rms_of_scan) const;
};

Fusion::Fusion(FusionOptions options) : impl_(std::make_unique<Impl>()) {
  impl_->options = std::move(options);
}
Fusion::~Fusion() = default;
size_t Fusion::size() const {
  return impl_->surfaces.size();
}

void Fusion::add(const TaggedScan& scan) {
  const Stopwatch preprocessing;
  ScanSurface surface = preprocess(scan, impl_->options.preprocess);
  impl_->surfaces.push_back(std::move(surface));
  impl_->targets.emplace_back(impl_->surfaces.back());
  impl_->preprocess_s += preprocessing.seconds();
  const Stopwatch matching;
  impl_->match_with_earlier(impl_->surfaces.size() - 1);
  impl_->pairs_s += matching.seconds();
}

void Fusion::Impl::match_with_earlier(size_t source) {
  for (size_t target = 0; target < source; ++target) {
    const ScanSurface& a = surfaces[target];
    const ScanSurface& b = surfaces[source];
    const double sigma_mm = relative_sigma_mm(a, b);
    const double cell_mm = std::clamp(3 * sigma_mm, 10 * a.spacing_mm, 30.0);
    const double overlap = predicted_overlap(a, b, cell_mm);
    if (overlap < options.min_overlap) continue;
    PoseGraphEdge edge;
    edge.target = target;
    edge.source = source;
    edge.odometry = source == target + 1;
    edge.predicted_overlap = overlap;
    GicpOptions gicp = options.gicp;
    gicp.max_distance_mm = std::clamp(3 * sigma_mm, 8 * a.spacing_mm, 20.0);
    edge.match =
        register_pair(targets[target], b, a.part_from_sensor.mean.inverse() * b.part_from_sensor.mean, gicp);
    const auto prune = [&](const std::string& why) {
      edge.kept = false;
      edge.reason = why;
    };
    if (edge.match.inliers < 100) {
      prune("only " + std::to_string(edge.match.inliers) + " matching points");
    } else if (!edge.match.converged) {
      prune("pairwise registration did not converge");
    }
    edges.push_back(std::move(edge));
  }
}

OverlapResidual Fusion::Impl::overlap_residual(const std::vector<Pose>& poses,
                                               std::vector<double>* rms_of_scan) const {
  std::vector<float> all;
  std::vector<std::vector<float>> of_scan(surfaces.size());
  for (const auto& edge : edges) {
    if (!edge.kept) continue;
    std::vector<float> pair;
    collect_residuals(targets[edge.target], poses[edge.target], surfaces[edge.source], poses[edge.source],
                      pair);
    collect_residuals(targets[edge.source], poses[edge.source], surfaces[edge.target], poses[edge.target],
                      pair);
    all.insert(all.end(), pair.begin(), pair.end());
    for (size_t s : {edge.target, edge.source}) of_scan[s].insert(of_scan[s].end(), pair.begin(), pair.end());
  }
  if (rms_of_scan) {
    rms_of_scan->clear();
    for (auto& values : of_scan) rms_of_scan->push_back(trimmed_rms(std::move(values)));
  }
  const size_t matches = all.size();
  return {trimmed_rms(std::move(all)), matches};
}

FusionResult Fusion::finish() {
  Impl& impl = *impl_;
  if (impl.surfaces.empty()) throw InputError("registration: there is no scan to register");
  FusionResult result;
  const Stopwatch graph;
  std::vector<UncertainPose> tagged;
  std::vector<Eigen::Vector3d> centres;
  for (const auto& surface : impl.surfaces) {
    tagged.push_back(surface.part_from_sensor);
    centres.push_back(centroid(surface));
  }
  const PoseGraphResult adjusted = optimise_pose_graph(tagged, impl.edges, centres, impl.options.pose_graph);
  const double graph_s = graph.seconds();

  std::vector<Pose> before, after;
  for (size_t i = 0; i < tagged.size(); ++i) {
    before.push_back(tagged[i].mean);
    after.push_back(adjusted.part_from_sensor[i].mean);
  }
  const Stopwatch residuals;
  std::vector<double> rms_of_scan;
  result.before = impl.overlap_residual(before, nullptr);
  result.after = impl.overlap_residual(after, &rms_of_scan);
  const double residuals_s = residuals.seconds();

  // Scans that no kept edge connects to the first one, directly or through others.
  std::vector<bool> reached(tagged.size(), false);
  reached[0] = true;
  for (bool grew = true; grew;) {
    grew = false;
    for (const auto& edge : impl.edges) {
      if (!edge.kept || reached[edge.target] == reached[edge.source]) continue;
      reached[edge.target] = reached[edge.source] = true;
      grew = true;
    }
  }
  std::string lost;
  for (size_t i = 0; i < tagged.size(); ++i) {
    const ScanSurface& surface = impl.surfaces[i];
    ScanResult scan;
    scan.name = surface.name;
    scan.part_from_sensor = adjusted.part_from_sensor[i];
    scan.moved_mm = (after[i] * centres[i] - before[i] * centres[i]).norm();
    scan.rms_mm = rms_of_scan[i];
    scan.points = surface.cloud.size();
    scan.measured = surface.measured;
    scan.noise_mm = surface.noise_mm;
    scan.connected = reached[i];
    if (!reached[i]) lost += (lost.empty() ? "" : ", ") + surface.name;
    result.scans.push_back(std::move(scan));
  }
  result.trusted = lost.empty() && adjusted.converged;
  if (!lost.empty()) {
    result.reason = "not connected to the first scan by any usable overlap: " + lost;
  } else if (!adjusted.converged) {
    result.reason = "the pose graph did not converge";
  }

  const Stopwatch merging;
  std::vector<ScanSurface> surfaces(std::make_move_iterator(impl.surfaces.begin()),
                                    std::make_move_iterator(impl.surfaces.end()));
  result.merged = merge_surfaces(surfaces, after, impl.options.merge, &result.voxel_mm);
  // Normals of a closed part point away from its inside: if they enclose a negative volume, the scans'
  // grids were listed mirrored and no sensor position corrected them.
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& p : result.merged.points) middle += p.cast<double>();
  middle /= std::max<double>(1.0, static_cast<double>(result.merged.size()));
  double outward = 0;
  for (size_t i = 0; i < result.merged.size(); ++i)
    outward += (result.merged.points[i].cast<double>() - middle).dot(result.merged.normals[i].cast<double>());
  const bool sensor_known = std::all_of(surfaces.begin(), surfaces.end(), [](const ScanSurface& s) {
    size_t towards = 0;
    for (size_t i = 0; i < s.cloud.size(); ++i) towards += s.cloud.normals[i].dot(s.cloud.points[i]) < 0;
    return towards > s.cloud.size() * 9 / 10;
  });
  if (!sensor_known && outward < 0) {
    for (auto& n : result.merged.normals) n *= -1;
    result.normals_flipped = true;
  }
  result.edges = std::move(impl.edges);
  result.timings_s = {{"preprocess", impl.preprocess_s},
                      {"pairs", impl.pairs_s},
                      {"pose_graph", graph_s},
                      {"residuals", residuals_s},
                      {"merge", merging.seconds()}};
  return result;
}

}  // namespace gantry
