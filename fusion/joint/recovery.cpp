#include "joint/recovery.h"

#include <tbb/parallel_for.h>

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gantry/fusion/global_initialisation.h"

namespace gantry::internal {
namespace {

/// Agreement of one scan with a set, both ways, by a tolerance that coarse alignment reaches.
struct Fit {
  size_t matched = 0, violated = 0, background = 0;
  double violation() const {
    return static_cast<double>(violated) / static_cast<double>(std::max<size_t>(1, matched + violated));
  }
  double score() const {
    return static_cast<double>(matched) - 20 * static_cast<double>(violated) -
           0.1 * static_cast<double>(background);
  }
};

/// What coarse alignment reaches, in spacings of the finer level.
constexpr double kCoarseTolerance = 0.85;
constexpr size_t kFitSamples = 1500;
constexpr double kAgrees = 0.03;  ///< Violation below which a coarsely placed scan may belong to a set.
/// ... and below which two finely placed scans agree; and fewer violating samples than this are chance.
constexpr double kAgreesFinely = 0.005;
constexpr size_t kChance = 8;
/// More scans than this are set together where they agree.
constexpr size_t kMany = 16;
constexpr double kStart_mm = 15;        ///< How wrong a start may be.
constexpr double kLeastMatched = 0.04;  ///< Of the samples, for two scans to say anything of each other.

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
  return fit;
}

Fit fit_of_scan(const JointProblem& problem, const std::vector<size_t>& core, size_t scan, const Poses& poses,
                const Pose& pose) {
  Fit sum;
  for (const size_t c : core) {
    const Fit fit = fit_of_pair(problem, c, scan, poses[c], pose, kCoarseTolerance * problem.medium_mm);
    sum.matched += fit.matched;
    sum.violated += fit.violated;
    sum.background += fit.background;
  }
  return sum;
}

/// The largest set that hangs together by pairs that agree and in which no pair disagrees, grown greedily
/// from the best pair.
std::vector<size_t> consistent_core(const JointProblem& problem, const Poses& poses,
                                    const std::vector<bool>& suspects) {
  const size_t n = problem.size();
  const double tolerance_mm = std::max(6 * problem.noise_mm, problem.spacing_mm);
  std::vector<Fit> fits(n * n);
  tbb::parallel_for(size_t{0}, n * n, [&](size_t k) {
    const size_t a = k / n, b = k % n;
    if (a < b) fits[k] = fit_of_pair(problem, a, b, poses[a], poses[b], tolerance_mm);
  });
  const auto fit = [&](size_t a, size_t b) -> const Fit& {
    return fits[std::min(a, b) * n + std::max(a, b)];
  };
  const auto speaks = [&](const Fit& f) {
    return static_cast<double>(f.matched) > 2 * kLeastMatched * static_cast<double>(kFitSamples);
  };
  std::vector<size_t> best;
  size_t best_matched = 0;
  for (size_t seed = 0; seed < n; ++seed) {
    if (suspects[seed]) continue;
    std::vector<size_t> core = {seed};
    size_t matched = 0;
    while (true) {
      size_t next = n, next_matched = 0;
      for (size_t i = 0; i < n; ++i) {
        if (suspects[i] || std::find(core.begin(), core.end(), i) != core.end()) continue;
        size_t here = 0;
        bool clash = false;
        for (const size_t c : core) {
          const Fit& f = fit(c, i);
          clash = clash || (f.violation() > kAgreesFinely && f.violated > kChance);
          if (speaks(f)) here += f.matched;
        }
        if (!clash && here > next_matched) {
          next = i;
          next_matched = here;
        }
      }
      if (next == n) break;
      core.push_back(next);
      matched += next_matched;
    }
    if (core.size() > best.size() || (core.size() == best.size() && matched > best_matched)) {
      best = core;
      best_matched = matched;
    }
  }
  return best;
}

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

class Recovery {
 public:
  Recovery(const JointProblem& problem, Poses poses, std::vector<size_t> core, bool global)
      : problem_(problem), poses_(std::move(poses)), global_(global), core_(std::move(core)) {}

  Poses run() {
    std::vector<size_t> left;
    for (size_t i = 0; i < problem_.size(); ++i)
      if (std::find(core_.begin(), core_.end(), i) == core_.end()) left.push_back(i);
    // Each round sets the scan that fits best, and, where there are many, all that agree; a larger core gives
    // the others more to hold on to.
    while (!left.empty()) {
      std::vector<Placement> found(left.size());
      tbb::parallel_for(size_t{0}, left.size(),
                        [&](size_t k) { found[k] = best_of(left[k], starts_near(left[k])); });
      size_t best = index_of_best(found);
      if (found[best].fit.violation() > kAgrees && global_) {
        tbb::parallel_for(size_t{0}, left.size(), [&](size_t k) {
          const Placement proposed = best_of(left[k], proposals(left[k]));
          if (proposed.fit.score() > found[k].fit.score()) found[k] = proposed;
        });
        best = index_of_best(found);
      }
      std::vector<size_t> still_left;
      for (size_t k = 0; k < left.size(); ++k) {
        const bool agrees = found[k].fit.violation() < kAgreesFinely && found[k].fit.matched > kFitSamples;
        if (k != best && !(problem_.size() > kMany && agrees)) {
          still_left.push_back(left[k]);
          continue;
        }
        poses_[left[k]] = found[k].pose;
        core_.push_back(left[k]);
      }
      left = std::move(still_left);
    }
    return poses_;
  }

 private:
  struct Start {
    Pose pose;
    double error_mm;  ///< How wrong it may be.
  };
  struct Placement {
    Pose pose = Pose::Identity();
    Fit fit;
  };

  static size_t index_of_best(const std::vector<Placement>& found) {
    size_t best = 0;
    for (size_t k = 1; k < found.size(); ++k)
      if (found[k].fit.score() > found[best].fit.score()) best = k;
    return best;
  }

  /// The tag as seen from the core, and turned about the part's centre from there.
  std::vector<Start> starts_near(size_t scan) const {
    // The core has moved as a whole since it was tagged: the rotation closest to all its corrections.
    Eigen::Matrix3d rotations = Eigen::Matrix3d::Zero();
    Eigen::Vector3d shift = Eigen::Vector3d::Zero();
    for (const size_t c : core_) {
      const Pose moved = poses_[c] * problem_.priors[c].part_from_grid.inverse();
      rotations += moved.linear();
      shift += moved * problem_.centre - problem_.centre;
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rotations, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
    if (rotation.determinant() < 0) rotation = Eigen::Matrix3d::Identity();
    Pose common = Pose::Identity();
    common.linear() = rotation;
    common.translation() =
        problem_.centre - rotation * problem_.centre + shift / static_cast<double>(core_.size());
    const Pose tagged = common * problem_.priors[scan].part_from_grid;
    std::vector<Start> starts = {{tagged, 25}, {poses_[scan], 25}};
    // Corners of a cube and its axes: 14 directions to turn about, by two angles.
    for (const double angle : {0.26, 0.52})
      for (int x = -1; x <= 1; ++x)
        for (int y = -1; y <= 1; ++y)
          for (int z = -1; z <= 1; ++z) {
            const int nonzero = std::abs(x) + std::abs(y) + std::abs(z);
            if (nonzero != 1 && nonzero != 3) continue;
            Vector6d twist = Vector6d::Zero();
            twist.head<3>() = angle * Eigen::Vector3d(x, y, z).normalized();
            starts.push_back({exp_about(problem_.centre, twist) * tagged, kStart_mm});
          }
    return starts;
  }

  std::vector<Start> proposals(size_t scan) const {
    std::vector<Start> starts;
    GlobalInitialisationOptions options;
    options.sensor_at_origin = problem_.coarse.rays[scan]->central;
    const PointCloud source = thinned(*problem_.medium.levels[scan], 1500);
    for (size_t k = 0; k < std::min<size_t>(core_.size(), 4); ++k) {
      const size_t c = core_[k];
      if (problem_.coarse.rays[c]->central != options.sensor_at_origin) continue;
      for (const PoseProposal& proposal :
           propose_alignments(thinned(*problem_.medium.levels[c], 1500), source, options))
        starts.push_back({poses_[c] * proposal.target_from_source, 5});
    }
    return starts;
  }

  /// The scans of the core that have most in common with a scan at this pose.
  std::vector<size_t> core_near(size_t scan, const Pose& pose) const {
    if (core_.size() <= problem_.max_partners) return core_;
    CoarseScans scans;
    Poses poses;
    for (const size_t c : core_) {
      scans.levels.push_back(problem_.coarse.levels[c]);
      poses.push_back(poses_[c]);
    }
    scans.levels.push_back(problem_.coarse.levels[scan]);
    poses.push_back(pose);
    std::vector<size_t> near;
    for (const size_t place : partners_of_last(scans, poses, kStart_mm, problem_.max_partners))
      near.push_back(core_[place]);
    return near;
  }

  /// Aligns the scan to the core from every start and returns where it fits best.
  Placement best_of(size_t scan, const std::vector<Start>& starts) const {
    std::vector<Placement> placements(starts.size());
    tbb::parallel_for(size_t{0}, starts.size(), [&](size_t k) {
      // Only this scan and the core take part.
      CoarseScans coarse, medium;
      std::vector<PosePrior> priors;
      Poses poses;
      CoarseOptions options;
      Pairs pairs;
      const std::vector<size_t> core = core_near(scan, starts[k].pose);
      for (const size_t c : core) {
        pairs.emplace_back(priors.size(), core.size());
        add(c, poses_[c], coarse, medium, priors, poses);
      }
      add(scan, starts[k].pose, coarse, medium, priors, poses);
      options.fixed.assign(core.size(), true);
      options.fixed.push_back(false);
      options.start_mm = starts[k].error_mm;
      options.shrink = 0.85;
      options.end_mm = problem_.coarse_end_mm();
      options.samples = 150;
      align_coarse(coarse, pairs, priors, problem_.centre, options, poses);
      options.start_mm = problem_.coarse_end_mm();
      options.end_mm = problem_.medium_end_mm();
      options.start_angle_rad = options.end_angle_rad;
      options.samples = 300;
      align_coarse(medium, pairs, priors, problem_.centre, options, poses);
      placements[k].pose = poses.back();
      placements[k].fit = fit_of_scan(problem_, core, scan, poses_, poses.back());
    });
    Placement best;
    for (const Placement& p : placements)
      if (&p == &placements.front() || p.fit.score() > best.fit.score()) best = p;
    return best;
  }

  void add(size_t i, const Pose& pose, CoarseScans& coarse, CoarseScans& medium,
           std::vector<PosePrior>& priors, Poses& poses) const {
    coarse.levels.push_back(problem_.coarse.levels[i]);
    coarse.rays.push_back(problem_.coarse.rays[i]);
    medium.levels.push_back(problem_.medium.levels[i]);
    medium.rays.push_back(problem_.medium.rays[i]);
    priors.push_back({pose, Matrix6d::Zero()});  // the tag has misled already
    poses.push_back(pose);
  }

  const JointProblem& problem_;
  Poses poses_;
  bool global_;
  std::vector<size_t> core_;
};

}  // namespace

Poses recover(const JointProblem& problem, const Poses& poses, const std::vector<bool>& suspects,
              bool global) {
  return place_again(problem, poses, consistent_core(problem, poses, suspects), global);
}

Poses place_again(const JointProblem& problem, const Poses& poses, std::vector<size_t> core, bool global) {
  return Recovery(problem, poses, std::move(core), global).run();
}

}  // namespace gantry::internal
