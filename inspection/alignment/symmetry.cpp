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
constexpr double kApart = 0.26;         // rad, largest angle from any rotation to one of those sampled
constexpr double kDistinct = 0.05;      // rad; rotations nearer to each other are the same
constexpr double kMayLieOut = 5e-4;     // share of the samples: rounding at edges
constexpr int kSteps = 5;                // at each reach

/// The model's own samples laid onto the model after a motion about the centroid.
class SelfAlignment {
 public:
  SelfAlignment(const SignedDistance& model, double tolerance_mm)
      : model_(model), tolerance_mm_(tolerance_mm), samples_(sample_surface(model.mesh(), kSamples, 1)) {
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

  /// Comes to rest near `rotation`; false when the model does not cover itself there.
  bool settle(const Eigen::Matrix3d& rotation, Pose& motion) const {
    motion = Pose::Identity();
    motion.linear() = rotation;
    motion.translation() = frame_.centre - rotation * frame_.centre;
    for (const double reach : {0.6, 0.3, 0.15})
      for (int k = 0; k < kSteps; ++k) step(first_, reach * frame_.lever_mm, motion);
    if (share_out(first_, motion, 0.1 * frame_.lever_mm) > 0.1) return false;
    for (const double reach : {0.1, 0.05})
      for (int k = 0; k < kSteps; ++k) step(coarse_, reach * frame_.lever_mm, motion);
    if (share_out(coarse_, motion, 4 * tolerance_mm_ + 0.02 * frame_.lever_mm) > 0.1) return false;
    for (int k = 0; k < 4; ++k) step(coarse_, 0.02 * frame_.lever_mm, motion);
    if (share_out(coarse_, motion, 4 * tolerance_mm_) > 0.02) return false;
    for (int k = 0; k < 3; ++k) step(samples_, 10 * tolerance_mm_, motion);
    return share_out(samples_, motion, tolerance_mm_) <= kMayLieOut;
  }

  /// Whether two motions differ by no more than what the model's free motions do.
  bool same(const Pose& a, const Pose& b) const {
    const Pose difference = a.inverse() * b;
    if (rotation_log(difference.linear()).norm() < kDistinct) return true;
    // The turn about the centroid, as a motion, must lie in the free ones.
    Vector6d turn = Vector6d::Zero();
    turn.head<3>() = rotation_log(difference.linear()).normalized();
    turn.tail<3>().setZero();
    const auto& free = motions_.free;
    return free.cols() > 0 && (free.transpose() * turn).norm() > 0.98;
  }

 private:
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
  std::vector<unsigned char> covers(tried.size(), 0);
  tbb::parallel_for(size_t{0}, tried.size(), [&](size_t k) { covers[k] = self.settle(tried[k], motions[k]); });

  std::vector<EquivalentPose> found;
  for (size_t k = 0; k < tried.size(); ++k) {
    if (!covers[k] || self.same(Pose::Identity(), motions[k])) continue;
    if (std::any_of(found.begin(), found.end(),
                    [&](const EquivalentPose& f) { return self.same(f.motion, motions[k]); }))
      continue;
    found.push_back({motions[k], rotation_words(motions[k].linear())});
  }
  std::stable_sort(found.begin(), found.end(), [](const EquivalentPose& a, const EquivalentPose& b) {
    return rotation_log(a.motion.linear()).norm() + 1e-6 < rotation_log(b.motion.linear()).norm();
  });
  return found;
}

}  // namespace gantry
