#include "joint/placement.h"

#include <tbb/parallel_for.h>

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

#include "gantry/fusion/global_initialisation.h"

namespace gantry::internal {
namespace {

/// What coarse alignment reaches, in spacings of the finer level.
constexpr double kCoarseTolerance = 0.85;
constexpr double kStart_mm = 15;  ///< How wrong a start may be.
/// Tags that are further off than this (chi-square) are wrong, and one place is as likely as another.
constexpr double kFarFromTag = 60;
/// So many matches of a pair count half.
constexpr double kEnough = 500;
/// Steps in which starts are turned: coarse alignment finds its way from half of that and more.
constexpr double kTurn_rad = 0.26;

/// A scan thinned for features, in the frame of its sensor.
PointCloud thinned(const CoarseLevel& level, size_t most) {
  PointCloud cloud;
  const size_t used = std::min(most, level.filled.size());
  for (size_t k = 0; k < used; ++k) {
    const int i = level.filled[k * level.filled.size() / used];
    cloud.points.push_back(level.point(i));
    cloud.normals.push_back(level.normal(i).normalized());
  }
  return cloud;
}

/// The scans of the core that have most in common with a scan at this pose.
std::vector<size_t> core_near(const JointProblem& problem, const Core& core, size_t scan, const Pose& pose) {
  if (core.scans.size() <= problem.max_partners) return core.scans;
  CoarseScans scans;
  Poses poses;
  for (const size_t c : core.scans) {
    scans.levels.push_back(problem.coarse.levels[c]);
    poses.push_back(core.poses[c]);
  }
  scans.levels.push_back(problem.coarse.levels[scan]);
  poses.push_back(pose);
  std::vector<size_t> near;
  for (const size_t place : partners_of_last(scans, poses, kStart_mm, problem.max_partners))
    near.push_back(core.scans[place]);
  return near;
}

/// Moves one scan alone to where it fits the core at one level, and says how well it does.
Placement place(const JointProblem& problem, const Core& core, size_t scan, const Pose& start,
                const CoarseOptions& options, const CoarseScans& level, double tolerance_mm) {
  const std::vector<size_t> near = core_near(problem, core, scan, start);
  CoarseScans scans;
  std::vector<PosePrior> priors;
  Poses poses;
  Pairs pairs;
  const auto add = [&](size_t i, const Pose& pose) {
    scans.levels.push_back(level.levels[i]);
    scans.rays.push_back(level.rays[i]);
    priors.push_back({pose, Matrix6d::Zero()});  // the tag has misled already
    poses.push_back(pose);
  };
  for (const size_t c : near) {
    pairs.emplace_back(poses.size(), near.size());
    add(c, core.poses[c]);
  }
  add(scan, start);
  CoarseOptions its = options;
  its.fixed.assign(near.size(), true);
  its.fixed.push_back(false);
  align_coarse(scans, pairs, priors, problem.centre, its, poses);
  Placement placement;
  placement.pose = poses.back();
  for (const size_t c : near)
    placement.fit += fit_of_pair(problem, c, scan, core.poses[c], placement.pose, tolerance_mm);
  placement.fit.from_tag = from_tag(problem, core, scan, placement.pose);
  return placement;
}

}  // namespace

Fit& Fit::operator+=(const Fit& o) {
  matched += o.matched;
  violated += o.violated;
  background += o.background;
  support += o.support;
  from_tag += o.from_tag;
  return *this;
}

double Fit::violation() const {
  return static_cast<double>(violated) / static_cast<double>(std::max<size_t>(1, matched + violated));
}

double Fit::score() const {
  return support - 20 * static_cast<double>(violated) - 40 * from_tag - 0.1 * static_cast<double>(background);
}

Fit fit_of_pair(const JointProblem& problem, size_t a, size_t b, const Pose& pose_a, const Pose& pose_b,
                double tolerance_mm) {
  Fit fit;
  for (const auto& [target, source] : {std::pair{a, b}, {b, a}}) {
    const RangeSurface& s = problem.scans[source];
    const int stride = std::max(
        1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) / static_cast<double>(kFitSamples))));
    const Pose relative = target == a ? pose_a.inverse() * pose_b : pose_b.inverse() * pose_a;
    const Agreement agreement = compare(problem.scans[target], s, relative, tolerance_mm, stride);
    fit.matched += agreement.matched;
    fit.violated += agreement.in_front + agreement.contact;
    fit.background += agreement.background;
  }
  fit.support = static_cast<double>(fit.matched) / (1 + static_cast<double>(fit.matched) / kEnough);
  return fit;
}

bool Core::holds(size_t scan) const {
  return std::find(scans.begin(), scans.end(), scan) != scans.end();
}

Pose tag_seen_from(const JointProblem& problem, const Core& core, size_t scan) {
  // The rotation closest to all corrections, and the mean shift.
  Eigen::Matrix3d rotations = Eigen::Matrix3d::Zero();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  for (const size_t c : core.scans) {
    const Pose moved = core.poses[c] * problem.priors[c].part_from_grid.inverse();
    rotations += moved.linear();
    shift += moved * problem.centre - problem.centre;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rotations, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  if (rotation.determinant() < 0) rotation = Eigen::Matrix3d::Identity();
  Pose common = Pose::Identity();
  common.linear() = rotation;
  common.translation() =
      problem.centre - rotation * problem.centre + shift / static_cast<double>(core.scans.size());
  return common * problem.priors[scan].part_from_grid;
}

double from_tag(const JointProblem& problem, const Core& core, size_t scan, const Pose& pose) {
  const Vector6d off = log_about(problem.centre, pose * tag_seen_from(problem, core, scan).inverse());
  return std::min(kFarFromTag, off.dot(problem.priors[scan].information * off));
}

std::vector<Start> starts_near_tag(const JointProblem& problem, const Core& core, size_t scan,
                                   double widest_rad) {
  const Pose tagged = tag_seen_from(problem, core, scan);
  std::vector<Start> starts = {{tagged, 25}, {core.poses[scan], 25}};
  // Corners of a cube and its axes: 14 directions to turn about.
  for (double angle = kTurn_rad; angle < widest_rad + 0.5 * kTurn_rad; angle += kTurn_rad)
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z) {
          const int nonzero = std::abs(x) + std::abs(y) + std::abs(z);
          if (nonzero != 1 && nonzero != 3) continue;
          Vector6d twist = Vector6d::Zero();
          twist.head<3>() = angle * Eigen::Vector3d(x, y, z).normalized();
          starts.push_back({exp_about(problem.centre, twist) * tagged, kStart_mm});
        }
  return starts;
}

std::vector<Start> starts_from_features(const JointProblem& problem, const Core& core, size_t scan) {
  std::vector<Start> starts;
  GlobalInitialisationOptions options;
  options.sensor_at_origin = problem.coarse.rays[scan]->central;
  const PointCloud source = thinned(*problem.medium.levels[scan], 1500);
  for (size_t k = 0; k < std::min<size_t>(core.scans.size(), 4); ++k) {
    const size_t c = core.scans[k];
    if (problem.coarse.rays[c]->central != options.sensor_at_origin) continue;
    for (const PoseProposal& proposal :
         propose_alignments(thinned(*problem.medium.levels[c], 1500), source, options))
      starts.push_back({core.poses[c] * proposal.target_from_source, 5});
  }
  return starts;
}

std::vector<Placement> placements(const JointProblem& problem, const Core& core, size_t scan,
                                  const std::vector<Start>& starts, size_t most) {
  CoarseOptions options;
  options.shrink = 0.85;
  options.end_mm = problem.coarse_end_mm();
  options.samples = 150;
  std::vector<Placement> found(starts.size());
  tbb::parallel_for(size_t{0}, starts.size(), [&](size_t k) {
    CoarseOptions its = options;
    its.start_mm = starts[k].error_mm;
    found[k] = place(problem, core, scan, starts[k].pose, its, problem.coarse, problem.coarse_mm);
  });
  found = best_distinct(problem, std::move(found), 2 * most + 2);
  options.start_mm = problem.coarse_end_mm();
  options.end_mm = problem.medium_end_mm();
  options.start_angle_rad = options.end_angle_rad;
  options.samples = 300;
  tbb::parallel_for(size_t{0}, found.size(), [&](size_t k) {
    found[k] = place(problem, core, scan, found[k].pose, options, problem.medium,
                     kCoarseTolerance * problem.medium_mm);
  });
  return best_distinct(problem, std::move(found), most);
}

std::vector<Placement> best_distinct(const JointProblem& problem, std::vector<Placement> found, size_t most) {
  std::stable_sort(found.begin(), found.end(),
                   [](const Placement& a, const Placement& b) { return a.fit.score() > b.fit.score(); });
  std::vector<Placement> best;
  for (const Placement& p : found) {
    if (best.size() == most) break;
    const bool known = std::any_of(best.begin(), best.end(), [&](const Placement& q) {
      const Vector6d apart = log_about(problem.centre, p.pose * q.pose.inverse());
      return apart.tail<3>().norm() + problem.radius_mm * apart.head<3>().norm() < 2 * problem.coarse_mm;
    });
    if (!known) best.push_back(p);
  }
  return best;
}

}  // namespace gantry::internal
