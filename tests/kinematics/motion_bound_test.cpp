// The bound on which the collision check rests: no point of a body moves further than it says.

#include "collision/motion_bound.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

namespace gantry {
namespace {

using Corners = Eigen::Matrix<double, 3, 8>;

Corners corners_of(const Eigen::AlignedBox3d& box) {
  Corners corners;
  for (int k = 0; k < 8; ++k) corners.col(k) = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k));
  return corners;
}

Eigen::Vector3d moved(const std::vector<Joint>& joints, const std::vector<double>& q, Eigen::Vector3d point) {
  for (size_t j = joints.size(); j-- > 0;) point = pose_exp(joints[j].twist() * q[j]) * point;
  return point;
}

TEST(MotionBound, OfOneJointIsItsTravelOrItsArc) {
  const Corners corners = corners_of({Eigen::Vector3d(30, 0, -5), Eigen::Vector3d(40, 0, 5)});
  Joint joint;
  joint.kind = JointKind::kPrismatic;
  const std::vector<double> from{-10}, to{60}, deviation{0.5};
  MotionBound bound = bound_motion({&joint, 1}, from, to, deviation, 0, 1, corners);
  EXPECT_DOUBLE_EQ(bound.speed_mm, 70);
  EXPECT_DOUBLE_EQ(bound.deviation_mm, 0.5);
  joint.kind = JointKind::kRevolute;  // about z
  const std::vector<double> zero{0}, half_turn{-std::numbers::pi};
  bound = bound_motion({&joint, 1}, zero, half_turn, {}, 0, 1, corners);
  EXPECT_NEAR(bound.speed_mm, 40 * std::numbers::pi, 1e-9);
  EXPECT_EQ(bound.deviation_mm, 0);
}

TEST(MotionBound, SeesThatAJointAboveSwingsABodyAwayFromTheAxisBelow) {
  // A body on the axis of the turntable, which the tilt swings out by its arm of 100 mm while the table
  // turns.
  std::vector<Joint> joints(2);
  joints[0].direction = Eigen::Vector3d::UnitZ();
  joints[1].direction = Eigen::Vector3d::UnitX();
  const Corners corners = corners_of({Eigen::Vector3d(0, 0, 100), Eigen::Vector3d(0, 0, 100)});
  const std::vector<double> from{0, 0}, to{1, std::numbers::pi / 2};
  // At the end the point is at radius 100, and both joints move it: at least hypot(100, 157) per unit.
  const MotionBound bound = bound_motion(joints, from, to, {}, 0, 1, corners);
  EXPECT_GE(bound.speed_mm, std::hypot(100, 50 * std::numbers::pi));
  const Eigen::Vector3d before = moved(joints, {0.999, 0.999 * to[1]}, corners.col(0)),
                        after = moved(joints, to, corners.col(0));
  EXPECT_LE((after - before).norm(), 0.001 * bound.speed_mm);
}

TEST(MotionBound, HoldsForRandomChainsPathsAndPoints) {
  double tightest = 1e9, tightest_deviation = 1e9;
  for (uint64_t seed = 0; seed < 400; ++seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> gauss;
    std::uniform_real_distribution<double> uniform;
    const auto vector = [&](double scale) -> Eigen::Vector3d {
      return scale * Eigen::Vector3d(gauss(random), gauss(random), gauss(random));
    };
    std::vector<Joint> joints(1 + seed % 4);
    std::vector<double> from, to, deviation;
    for (Joint& joint : joints) {
      const bool prismatic = random() % 3 == 0;
      joint.kind = prismatic ? JointKind::kPrismatic : JointKind::kRevolute;
      joint.direction = vector(1).normalized();
      joint.point_mm = vector(50);
      const double scale = prismatic ? 100 : 2;
      from.push_back(scale * gauss(random));
      to.push_back(scale * gauss(random));
      deviation.push_back(0.02 * scale * uniform(random));
    }
    const Eigen::Vector3d a = vector(60), b = vector(60);
    const Eigen::AlignedBox3d box(a.cwiseMin(b), a.cwiseMax(b));
    const double begin = uniform(random), end = begin + (1 - begin) * uniform(random);
    const MotionBound bound = bound_motion(joints, from, to, deviation, begin, end, corners_of(box));
    for (int k = 0; k < 60; ++k) {
      const Eigen::Vector3d part(uniform(random), uniform(random), uniform(random));
      const Eigen::Vector3d point = box.min() + part.cwiseProduct(box.sizes());
      const auto q_at = [&](double s, double off) {
        std::vector<double> q;
        for (size_t j = 0; j < joints.size(); ++j)
          q.push_back(from[j] + s * (to[j] - from[j]) + off * deviation[j] * (random() % 2 ? 1 : -1));
        return q;
      };
      const double s = begin + (end - begin) * uniform(random);
      const double t = k % 2 ? std::min(end, s + 1e-4) : begin + (end - begin) * uniform(random);
      const double shift = (moved(joints, q_at(s, 0), point) - moved(joints, q_at(t, 0), point)).norm();
      ASSERT_LE(shift, std::abs(s - t) * bound.speed_mm * (1 + 1e-9) + 1e-9) << "seed " << seed;
      if (shift > 1e-6) tightest = std::min(tightest, std::abs(s - t) * bound.speed_mm / shift);
      const double off = (moved(joints, q_at(s, 0), point) - moved(joints, q_at(s, 1), point)).norm();
      ASSERT_LE(off, bound.deviation_mm * (1 + 1e-9)) << "seed " << seed;
      if (off > 1e-6) tightest_deviation = std::min(tightest_deviation, bound.deviation_mm / off);
    }
  }
  EXPECT_LT(tightest, 1.1) << "a bound that is never nearly reached is not tested";
  EXPECT_LT(tightest_deviation, 1.1);
}

}  // namespace
}  // namespace gantry
