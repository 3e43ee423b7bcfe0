#include "alignment/global_search.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_set>

#include "alignment/distance_field.h"
#include "alignment/samples.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/surface_samples.h"

namespace gantry::internal {
namespace {

constexpr size_t kRotations = 4000;
constexpr size_t kCoarsePoints = 300, kRefinePoints = 600, kFinePoints = 1500;
constexpr int kFirstSteps = 4, kNextSteps = 12, kFineSteps = 15;
constexpr int kFieldCells = 56;
constexpr size_t kRefined = 80, kPolished = 12;
constexpr double kDistinctCosine =
    0.995;                        // of 0.1 rad; poses closer than this, and about as far in mm, are one
constexpr double kOnModel = 0.5;  // cost above which a pose does not count as found

struct Box {
  Eigen::Vector3d mean, middle;
  double size;
};

Box box_of(const std::vector<Eigen::Vector3f>& points, const Eigen::Matrix3d& rotation) {
  Box box{Eigen::Vector3d::Zero(), {}, 0};
  Eigen::AlignedBox3d bounds;
  for (const auto& p : points) {
    const Eigen::Vector3d q = rotation * p.cast<double>();
    box.mean += q / static_cast<double>(points.size());
    bounds.extend(q);
  }
  box.middle = bounds.center();
  box.size = bounds.diagonal().norm();
  return box;
}

/// One step of a truncated point-to-plane fit; returns the cost before it. `foot(i, p, q, n)` gives the
/// closest surface of point i at p, false for none.
template <typename FootOf>
double step(const PointCloud& cloud, double reach_mm, const FootOf& foot, Pose& pose) {
  FitFrame frame;
  frame.centre = pose * cloud.points[cloud.size() / 2].cast<double>();
  frame.lever_mm = 10;
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = pose * cloud.points[i].cast<double>();
    Eigen::Vector3d q, n;
    const double squared = foot(i, p, q, n) ? (p - q).squaredNorm() / (reach_mm * reach_mm) : 1.0;
    cost += std::min(1.0, squared);
    if (squared >= 1) continue;
    const double weight = (1 - squared) * (1 - squared);
    const Vector6d j = frame.row(p, n);
    hessian.selfadjointView<Eigen::Lower>().rankUpdate(j, weight);
    gradient -= weight * n.dot(p - q) * j;
  }
  // Damped: what little surface holds must not be thrown far.
  hessian.diagonal().array() += 1e-3 * hessian.trace() + 1e-9;
  pose = frame.motion(hessian.selfadjointView<Eigen::Lower>().ldlt().solve(gradient)) * pose;
  return cost / static_cast<double>(cloud.size());
}

void refine(const PointCloud& cloud, const SignedDistance& model, double reach_mm, int steps,
            FoundPose& found) {
  std::vector<int> near(cloud.size(), -1);
  const auto foot = [&](size_t i, const Eigen::Vector3d& p, Eigen::Vector3d& q, Eigen::Vector3d& n) {
    const Eigen::Vector3f at = p.cast<float>();
    const auto reach = static_cast<float>(reach_mm);
    const auto value =
        cloud.has_normals()
            ? model(at, found.cad_from_cloud.linear().cast<float>() * cloud.normals[i], 0.7f, reach, near[i])
            : model(at, reach, near[i]);
    if (!value) return false;
    near[i] = value->triangle;
    q = value->closest.cast<double>();
    n = model.mesh().normal(static_cast<size_t>(value->triangle)).cast<double>();
    return true;
  };
  for (int k = 0; k < steps; ++k) {
    Pose next = found.cad_from_cloud;
    step(cloud, reach_mm, foot, next);
    found.cad_from_cloud = next;
  }
  Pose copy = found.cad_from_cloud;
  found.cost = step(cloud, reach_mm, foot, copy);
}

double rotations_cosine(const Pose& a, const Pose& b) {
  return 0.5 * (a.linear().cwiseProduct(b.linear()).sum() - 1);
}

/// Sorted by cost, without those that end where a better one does, `count` at most.
std::vector<FoundPose> best_distinct(std::vector<FoundPose> poses, const Eigen::Vector3d& cloud_middle,
                                     double apart_mm, size_t count) {
  std::stable_sort(poses.begin(), poses.end(),
                   [](const FoundPose& a, const FoundPose& b) { return a.cost < b.cost; });
  std::vector<FoundPose> kept;
  for (const FoundPose& pose : poses) {
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const FoundPose& k) {
      return (k.cad_from_cloud * cloud_middle - pose.cad_from_cloud * cloud_middle).norm() < apart_mm &&
             rotations_cosine(k.cad_from_cloud, pose.cad_from_cloud) > kDistinctCosine;
    });
    if (!known) kept.push_back(pose);
    if (kept.size() == count) break;
  }
  return kept;
}

}  // namespace

void settle(const PointCloud& cloud, const DistanceField& field, double reach_mm, int steps,
            FoundPose& found) {
  const auto foot = [&](size_t, const Eigen::Vector3d& p, Eigen::Vector3d& q, Eigen::Vector3d& n) {
    const DistanceField::Foot& f = field.foot(p.cast<float>());
    q = f.point.cast<double>();
    n = f.normal.cast<double>();
    return true;
  };
  for (int k = 0; k < steps; ++k) step(cloud, reach_mm, foot, found.cad_from_cloud);
  Pose copy = found.cad_from_cloud;
  found.cost = step(cloud, reach_mm, foot, copy);
}

PointCloud thinned(const PointCloud& cloud, size_t count) {
  Eigen::AlignedBox3f box;
  for (const auto& p : cloud.points) box.extend(p);
  PointCloud out;
  float cell = std::max(1e-6f, box.sizes().maxCoeff());
  while (out.size() < count && out.size() < cloud.size() && cell > 1e-5f * box.sizes().maxCoeff()) {
    out = {};
    cell *= 0.85f;
    std::unordered_set<uint64_t> taken;
    for (size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Array3<uint64_t> at = ((cloud.points[i] - box.min()) / cell).array().cast<uint64_t>();
      // By side as well: both faces of a thin wall count.
      uint64_t side = 0;
      if (cloud.has_normals())
        for (int k = 0; k < 3; ++k) side |= static_cast<uint64_t>(cloud.normals[i][k] > 0) << k;
      if (!taken.insert(side << 60 | at.z() << 40 | at.y() << 20 | at.x()).second) continue;
      out.points.push_back(cloud.points[i]);
      if (cloud.has_normals()) out.normals.push_back(cloud.normals[i]);
    }
  }
  return out;
}

std::vector<Eigen::Matrix3d> even_rotations(size_t count) {
  std::vector<Eigen::Matrix3d> rotations;
  for (size_t i = 0; i < count; ++i) {
    const double s = static_cast<double>(i) + 0.5, t = s / static_cast<double>(count);
    const double a = 2 * std::numbers::pi * s / std::numbers::sqrt2;
    const double b = 2 * std::numbers::pi * s / 1.533751168755204288118041;
    const double r = std::sqrt(t), rest = std::sqrt(1 - t);
    rotations.push_back(
        Eigen::Quaterniond(rest * std::cos(b), r * std::sin(a), r * std::cos(a), rest * std::sin(b))
            .toRotationMatrix());
  }
  return rotations;
}

std::vector<FoundPose> find_poses(const PointCloud& cloud, const SignedDistance& model) {
  if (cloud.points.empty()) return {};
  const PointCloud coarse = thinned(cloud, kCoarsePoints), middling = thinned(cloud, kRefinePoints),
                   fine = thinned(cloud, kFinePoints);
  const DistanceField field(model, kFieldCells);
  const PointCloud surface = thinned(sample_surface(model.mesh(), 20000, 1), kFinePoints);
  const Box target = box_of(surface.points, Eigen::Matrix3d::Identity());
  const Eigen::Vector3d middle = box_of(coarse.points, Eigen::Matrix3d::Identity()).middle;
  const double wide = 0.15 * target.size, narrow = 0.02 * target.size, apart = 0.03 * target.size;

  const std::vector<Eigen::Matrix3d> rotations = even_rotations(kRotations);
  std::vector<FoundPose> poses(2 * rotations.size());
  tbb::parallel_for(size_t{0}, rotations.size(), [&](size_t r) {
    const Box box = box_of(coarse.points, rotations[r]);
    for (const size_t way : {0, 1}) {
      FoundPose& pose = poses[2 * r + way];
      pose.cad_from_cloud.linear() = rotations[r];
      pose.cad_from_cloud.translation() = way == 0 ? target.mean - box.mean : target.middle - box.middle;
      settle(coarse, field, wide, kFirstSteps, pose);
    }
  });
  poses = best_distinct(std::move(poses), middle, apart, poses.size() / 4);
  tbb::parallel_for(size_t{0}, poses.size(),
                    [&](size_t k) { settle(coarse, field, wide / 2, kNextSteps, poses[k]); });
  poses = best_distinct(std::move(poses), middle, apart, kRefined);
  tbb::parallel_for(size_t{0}, poses.size(), [&](size_t k) {
    refine(middling, model, 2 * narrow, kFineSteps, poses[k]);
    refine(middling, model, narrow, 5, poses[k]);
  });
  poses = best_distinct(std::move(poses), middle, apart, kPolished);
  tbb::parallel_for(size_t{0}, poses.size(),
                    [&](size_t k) { refine(fine, model, narrow / 3, kFineSteps, poses[k]); });
  return best_distinct(std::move(poses), middle, apart, kPolished);
}

std::optional<Pose> find_pose(const PointCloud& cloud, const SignedDistance& model) {
  const std::vector<FoundPose> poses = find_poses(cloud, model);
  if (poses.empty() || poses.front().cost > kOnModel) return std::nullopt;
  return poses.front().cad_from_cloud;
}

}  // namespace gantry::internal
