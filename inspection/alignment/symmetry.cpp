#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "alignment/global_search.h"
#include "alignment/normal_equations.h"
#include "alignment/samples.h"
#include "alignment/tessellation.h"
#include "alignment/words.h"
#include "gantry/geometry/surface_samples.h"
#include "gantry/inspection/alignment.h"

namespace gantry {
namespace {

using namespace internal;

constexpr size_t kRotations = 4000, kFirst = 100, kCoarse = 400, kSamples = 20000;
constexpr double kApart = 0.26;      // rad, largest angle from any rotation to one of those sampled
constexpr double kDistinct = 0.05;   // rad; rotations nearer to each other are the same
constexpr double kCoarseCost = 0.3;  // mean square distance in units of the last reach, cut at 1
constexpr double kMayLieOut = 5e-4;  // share of the samples: rounding at edges
constexpr int kSteps = 5;            // at each reach
constexpr int kFieldCells = 40;

/// The model's own samples laid onto the model after a motion about the centroid.
class SelfAlignment {
 public:
  SelfAlignment(const SignedDistance& model, double tolerance_mm)
      : model_(model),
        field_(model, kFieldCells),
        tolerance_mm_(tolerance_mm),
        samples_(sample_surface(model.mesh(), kSamples, 1)) {
    std::vector<Eigen::Vector3d> points;
    for (const auto& p : samples_.points) points.push_back(p.cast<double>());
    frame_ = frame_of(points);
    first_ = thinned(samples_, kFirst);
    coarse_ = thinned(samples_, kCoarse);
    for (const auto& p : points)
      spread_ += (p - frame_.centre) * (p - frame_.centre).transpose() / static_cast<double>(points.size());
    std::vector<Pair> pairs;
    find_pairs(samples_, model, Pose::Identity(), 1, 0.7, pairs);
    const std::vector<double> facets = facet_angles(model.mesh(), adjacent_triangles(model.mesh()));
    motions_ = split_motions(normal_equations(pairs, std::vector<double>(pairs.size(), 1.0),
                                              std::vector<unsigned char>(pairs.size(), 0), facets, frame_));
  }

  /// A symmetry keeps the moments about the centroid. By how much a rotation changes those of second order,
  /// and how fast a further turn could, bounds what can be found near it.
  bool worth_trying(const Eigen::Matrix3d& rotation) const {
    const Eigen::Matrix3d uneven = spread_ - spread_.trace() / 3 * Eigen::Matrix3d::Identity();
    const double change = (rotation * uneven * rotation.transpose() - uneven).norm();
    return change <= 2 * kApart * uneven.norm() + 1e-2 * spread_.norm();
  }

  /// Comes to rest near `rotation`; false when the model hardly covers itself there.
  bool settle_near(const Eigen::Matrix3d& rotation, Pose& motion) const {
    FoundPose found;
    found.cad_from_cloud.linear() = rotation;
    found.cad_from_cloud.translation() = frame_.centre - rotation * frame_.centre;
    for (const double reach : {0.6, 0.3, 0.15})
      settle(first_, field_, reach * frame_.lever_mm, kSteps, found);
    if (found.cost > kCoarseCost) return false;
    motion = found.cad_from_cloud;
    for (const double reach : {0.1, 0.05})
      for (int k = 0; k < kSteps; ++k) step(coarse_, reach * frame_.lever_mm, motion);
    return share_out(coarse_, motion, 4 * tolerance_mm_ + 0.01 * frame_.lever_mm) < 0.05;
  }

  /// Looks closely at a motion that settle_near() found.
  bool covers(Pose& motion) const {
    for (int k = 0; k < kSteps; ++k) step(samples_, 0.02 * frame_.lever_mm + tolerance_mm_, motion);
    return share_out(samples_, motion, tolerance_mm_) <= kMayLieOut;
  }

  /// Whether two motions differ by no more than what the model's free motions do.
  bool same(const Pose& a, const Pose& b) const {
    const Pose difference = a.inverse() * b;
    if (rotation_log(difference.linear()).norm() < kDistinct) return true;
    return held_share(rotation_log(difference.linear()).normalized()) < kDistinct;
  }

  std::string words(const Pose& motion) const {
    const Eigen::Vector3d turn = rotation_log(motion.linear());
    // A half turn of a turned part about any axis across its own.
    if (motions_.free.cols() == 1 && turn.norm() > 3.1) {
      const Eigen::Vector3d axis = motions_.free.col(0).head<3>();
      if (std::abs(axis.dot(turn.normalized())) < 0.05)
        return "turned end for end (by 180 degrees about any axis across " +
               direction_words(axis.normalized()) + ")";
    }
    return rotation_words(motion.linear());
  }

 private:
  /// How much of a turn about the centroid is not free: 0 to 1.
  double held_share(const Eigen::Vector3d& axis) const {
    if (motions_.free.cols() == 0) return 1;
    Vector6d turn = Vector6d::Zero();
    turn.head<3>() = axis;
    return (motions_.held.transpose() * turn).norm();
  }

  void step(const PointCloud& cloud, double reach_mm, Pose& motion) const {
    std::vector<Pair> pairs;
    find_pairs(cloud, model_, motion, reach_mm, 0.5, pairs);
    Matrix6d hessian = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    for (const Pair& p : pairs) {
      if (!p.found) continue;
      const Vector6d j = frame_.row(p.point, p.normal);
      hessian += j * j.transpose();
      gradient -= p.distance * j;
    }
    hessian.diagonal().array() += 1e-3 * hessian.trace() + 1e-9;
    motion = frame_.motion(hessian.ldlt().solve(gradient)) * motion;
  }

  double share_out(const PointCloud& cloud, const Pose& motion, double limit_mm) const {
    std::vector<Pair> pairs;
    find_pairs(cloud, model_, motion, limit_mm, 0.5, pairs);
    const auto out = std::count_if(pairs.begin(), pairs.end(), [](const Pair& p) { return !p.found; });
    return static_cast<double>(out) / static_cast<double>(pairs.size());
  }

  const SignedDistance& model_;
  DistanceField field_;
  double tolerance_mm_;
  PointCloud samples_, coarse_, first_;
  FitFrame frame_;
  Eigen::Matrix3d spread_ = Eigen::Matrix3d::Zero();
  HeldMotions motions_;
};

}  // namespace

std::vector<EquivalentPose> find_symmetries(const SignedDistance& model, double tolerance_mm) {
  const SelfAlignment self(model, tolerance_mm);
  std::vector<Eigen::Matrix3d> tried;
  for (const Eigen::Matrix3d& r : even_rotations(kRotations))
    if (self.worth_trying(r)) tried.push_back(r);
  std::vector<Pose> motions(tried.size());
  std::vector<unsigned char> rests(tried.size(), 0);
  tbb::parallel_for(size_t{0}, tried.size(),
                    [&](size_t k) { rests[k] = self.settle_near(tried[k], motions[k]); });

  std::vector<EquivalentPose> found;
  std::vector<Pose> looked_at{Pose::Identity()};
  for (size_t k = 0; k < tried.size(); ++k) {
    if (!rests[k] || std::any_of(looked_at.begin(), looked_at.end(),
                                 [&](const Pose& p) { return self.same(p, motions[k]); }))
      continue;
    looked_at.push_back(motions[k]);
    if (self.covers(motions[k])) found.push_back({motions[k], self.words(motions[k])});
  }
  std::stable_sort(found.begin(), found.end(), [](const EquivalentPose& a, const EquivalentPose& b) {
    return rotation_log(a.motion.linear()).norm() + 1e-6 < rotation_log(b.motion.linear()).norm();
  });
  return found;
}

}  // namespace gantry
