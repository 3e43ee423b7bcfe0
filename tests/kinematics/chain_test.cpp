#include "gantry/kinematics/chain.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <functional>
#include <numbers>
#include <random>

namespace gantry {
namespace {

/// Random chains of both kinds of joint, and random joint values.
class ChainTest : public ::testing::Test {
 protected:
  double gauss() { return normal_(random_); }
  Eigen::Vector3d gauss3(double sigma) {
    return Eigen::Vector3d::NullaryExpr([&] { return sigma * gauss(); });
  }
  Pose pose() { return pose_from_position_rpy(gauss3(200), gauss3(1)); }
  Chain chain(size_t joints) {
    Chain c;
    for (size_t i = 0; i < joints; ++i) {
      Joint j;
      j.kind = random_() % 2 ? JointKind::kRevolute : JointKind::kPrismatic;
      j.direction = gauss3(1).normalized();
      j.point_mm = gauss3(150);
      c.joints.push_back(j);
    }
    c.base_from_part_at_zero = pose();
    c.base_from_sensor = pose();
    return c;
  }
  std::vector<double> values(const Chain& c) {
    std::vector<double> q;
    for (const auto& j : c.joints) q.push_back(j.kind == JointKind::kRevolute ? gauss() : 100 * gauss());
    return q;
  }
  /// Turned about a random axis across `v`, by an angle with this sigma in each of the two ways.
  Eigen::Vector3d tilted(const Eigen::Vector3d& v, double sigma_rad) {
    const Eigen::Vector3d a = v.unitOrthogonal(), b = v.cross(a);
    return rotation_exp(sigma_rad * (gauss() * a + gauss() * b)) * v;
  }
  Eigen::Vector3d shifted_across(const Eigen::Vector3d& point, const Eigen::Vector3d& direction,
                                 double sigma_mm) {
    const Eigen::Vector3d a = direction.unitOrthogonal(), b = direction.cross(a);
    return point + sigma_mm * (gauss() * a + gauss() * b);
  }

  std::mt19937 random_{7};
  std::normal_distribution<double> normal_;
};

/// Error of `actual` as UncertainPose defines it: actual = pose_exp(error) * mean.
Vector6d error_of(const Pose& actual, const Pose& mean) {
  return pose_log(actual * mean.inverse());
}

/// Expects the covariance of what `draw` returns to be `predicted`, in every direction: in those where
/// the prediction has variance the ratio must be one, in the others there must be none.
void expect_covariance(const Matrix6d& predicted, const std::function<Vector6d()>& draw) {
  constexpr int kSamples = 20'000;
  constexpr double kLever_mm = 100;  // makes rotations and translations comparable
  Vector6d scale;
  scale << Eigen::Vector3d::Constant(kLever_mm), Eigen::Vector3d::Ones();
  Matrix6d sampled = Matrix6d::Zero();
  for (int i = 0; i < kSamples; ++i) {
    const Vector6d e = scale.cwiseProduct(draw());
    sampled += e * e.transpose() / kSamples;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scale.asDiagonal() * predicted * scale.asDiagonal());
  const Vector6d variances = solver.eigenvalues();
  const double largest = variances(5);
  ASSERT_GT(largest, 0);
  Matrix6d whitener = Matrix6d::Zero();
  int rank = 0;
  for (int i = 0; i < 6; ++i) {
    const Vector6d v = solver.eigenvectors().col(i);
    if (variances(i) > 1e-5 * largest)
      whitener.row(rank++) = v.transpose() / std::sqrt(variances(i));
    else
      EXPECT_LT(v.dot(sampled * v), 1e-4 * largest);
  }
  const Matrix6d ratio = whitener * sampled * whitener.transpose();
  EXPECT_LT((ratio.topLeftCorner(rank, rank) - Eigen::MatrixXd::Identity(rank, rank)).cwiseAbs().maxCoeff(),
            0.06)
      << ratio;
}

TEST_F(ChainTest, AllJointsAtZeroGiveTheCalibratedPose) {
  for (size_t n = 0; n <= 5; ++n) {
    const Chain c = chain(n);
    const std::vector<double> zero(n, 0.0);
    EXPECT_TRUE(c.base_from_part(zero).isApprox(c.base_from_part_at_zero, 1e-12));
    EXPECT_TRUE(
        c.part_from_sensor(zero).isApprox(c.base_from_part_at_zero.inverse() * c.base_from_sensor, 1e-12));
  }
}

TEST_F(ChainTest, PrismaticJointMovesThePartAlongItsDirection) {
  Chain c = chain(1);
  c.joints[0].kind = JointKind::kPrismatic;
  const std::vector<double> q{37.5};
  const Eigen::Vector3d p_part = gauss3(100);
  EXPECT_TRUE((c.base_from_part(q) * p_part)
                  .isApprox(c.base_from_part_at_zero * p_part + 37.5 * c.joints[0].direction, 1e-12));
}

TEST_F(ChainTest, RevoluteJointTurnsRightHandedAboutItsAxis) {
  Chain c = chain(1);
  c.joints[0].kind = JointKind::kRevolute;
  const Joint& j = c.joints[0];
  const Pose zero = c.base_from_part_at_zero;
  for (const double angle : {0.3, -1.2, 3.0}) {
    const Pose turned = c.base_from_part(std::vector{angle});
    const Eigen::Vector3d on_axis = zero.inverse() * (j.point_mm + 55 * j.direction), p = gauss3(100);
    EXPECT_TRUE((turned * on_axis).isApprox(zero * on_axis, 1e-10)) << "a point on the axis stays";
    const Eigen::Vector3d expected =
        Eigen::AngleAxisd(angle, j.direction) * (zero * p - j.point_mm) + j.point_mm;
    EXPECT_TRUE((turned * p).isApprox(expected, 1e-10));
  }
  EXPECT_TRUE(c.base_from_part(std::vector{2 * std::numbers::pi}).isApprox(zero, 1e-10));
}

TEST_F(ChainTest, ALaterJointRidesOnTheEarlierOnes) {
  // Turning the first joint by 90 degrees about z turns the travel of the second from x to y.
  Chain c;
  c.joints.resize(2);
  c.joints[1].kind = JointKind::kPrismatic;
  c.joints[1].direction = Eigen::Vector3d::UnitX();
  const Pose p = c.base_from_part(std::vector{std::numbers::pi / 2, 10.0});
  EXPECT_TRUE(p.translation().isApprox(Eigen::Vector3d(0, 10, 0), 1e-12));
}

TEST_F(ChainTest, JointJacobianAgreesWithNumericDerivatives) {
  constexpr double kStep = 1e-4;
  for (int trial = 0; trial < 200; ++trial) {
    const Chain c = chain(1 + trial % 5);
    const std::vector<double> q = values(c);
    const Pose mean = c.part_from_sensor(q);
    const auto jacobian = c.joint_jacobian(q);
    ASSERT_EQ(jacobian.cols(), static_cast<Eigen::Index>(q.size()));
    for (size_t i = 0; i < q.size(); ++i) {
      std::vector<double> more = q, less = q;
      more[i] += kStep;
      less[i] -= kStep;
      const Vector6d numeric =
          (error_of(c.part_from_sensor(more), mean) - error_of(c.part_from_sensor(less), mean)) / (2 * kStep);
      const Vector6d column = jacobian.col(static_cast<Eigen::Index>(i));
      ASSERT_LT((numeric - column).norm(), 1e-5 * (1 + column.norm()));
    }
  }
}

TEST_F(ChainTest, IndependentCovarianceIsThatOfJointNoise) {
  for (size_t n = 1; n <= 5; ++n) {
    SCOPED_TRACE(n);
    Chain c = chain(n);
    for (auto& j : c.joints) j.repeatability = j.kind == JointKind::kRevolute ? 1e-4 : 1e-2;
    const std::vector<double> q = values(c);
    const UncertainPose uncertain = c.uncertain_part_from_sensor(q);
    EXPECT_TRUE(uncertain.mean.isApprox(c.part_from_sensor(q)));
    EXPECT_EQ(uncertain.shared(), Matrix6d::Zero());
    expect_covariance(uncertain.independent, [&] {
      std::vector<double> noisy = q;
      for (size_t i = 0; i < n; ++i) noisy[i] += c.joints[i].repeatability * gauss();
      return error_of(c.part_from_sensor(noisy), uncertain.mean);
    });
  }
}

TEST_F(ChainTest, SystematicErrorsOfTheSensorAddToWhatEveryViewHasOfItsOwn) {
  Chain c = chain(3);
  for (auto& j : c.joints) j.repeatability = 1e-3;
  const std::vector<double> q = values(c);
  const UncertainPose before = c.uncertain_part_from_sensor(q);
  c.sensor_systematic_sigma_mm = 0.02;
  const UncertainPose after = c.uncertain_part_from_sensor(q);
  EXPECT_EQ(after.shared(), before.shared());
  const Matrix6d added = after.independent - before.independent;
  Matrix6d expected = Matrix6d::Zero();
  expected.diagonal() << 4e-8, 4e-8, 4e-8, 4e-4, 4e-4, 4e-4;  // over 100 mm, and at the part's origin
  EXPECT_TRUE(added.isApprox(expected, 1e-9)) << added;
}

TEST_F(ChainTest, SharedCovarianceIsThatOfAMiscalibratedCell) {
  for (size_t n = 1; n <= 5; ++n) {
    SCOPED_TRACE(n);
    Chain c = chain(n);
    for (auto& j : c.joints) {
      j.direction_sigma_rad = 3e-4;
      j.point_sigma_mm = 0.05;
    }
    if (n % 2) {  // also alone, so that it cannot hide an error of the joints
      c.sensor_position_sigma_mm = 0.02;
      c.sensor_rotation_sigma_rad = 2e-4;
    }
    const std::vector<double> q = values(c);
    const UncertainPose uncertain = c.uncertain_part_from_sensor(q);
    EXPECT_EQ(uncertain.independent, Matrix6d::Zero());
    EXPECT_TRUE(uncertain.covariance().isApprox(uncertain.shared()));
    expect_covariance(uncertain.shared(), [&] {
      Chain real = c;
      for (auto& j : real.joints) {
        j.point_mm = shifted_across(j.point_mm, j.direction, j.point_sigma_mm);
        j.direction = tilted(j.direction, j.direction_sigma_rad);
      }
      real.base_from_sensor.translation() += gauss3(c.sensor_position_sigma_mm);
      real.base_from_sensor.linear() *= rotation_exp(gauss3(c.sensor_rotation_sigma_rad));
      return error_of(real.part_from_sensor(q), uncertain.mean);
    });
  }
}

/// The chain with one of its parameters wrong by `sigmas`, in the order of the factor's columns (chain.h).
Chain with_wrong_parameter(Chain c, size_t parameter, double sigmas) {
  size_t next = 0;
  const auto is_next = [&](double sigma) { return sigma > 0 && next++ == parameter; };
  for (Joint& j : c.joints) {
    const Eigen::Vector3d across[2] = {j.direction.unitOrthogonal(),
                                       j.direction.cross(j.direction.unitOrthogonal())};
    const Eigen::Vector3d direction = j.direction;
    for (const Eigen::Vector3d& v : across)
      if (is_next(j.direction_sigma_rad))
        j.direction = rotation_exp(sigmas * j.direction_sigma_rad * v) * direction;
    if (j.kind == JointKind::kPrismatic) continue;
    for (const Eigen::Vector3d& v : across)
      if (is_next(j.point_sigma_mm)) j.point_mm += sigmas * j.point_sigma_mm * v;
  }
  Vector6d mounting = Vector6d::Zero();
  for (int k = 0; k < 6; ++k) {
    const double sigma = k < 3 ? c.sensor_rotation_sigma_rad : c.sensor_position_sigma_mm;
    if (is_next(sigma)) mounting[k] = sigmas * sigma;
  }
  c.base_from_sensor = c.base_from_sensor * pose_exp(mounting);
  return c;
}

TEST_F(ChainTest, SharedFactorAgreesWithNumericDerivatives) {
  constexpr double kStep = 1e-2;  // sigmas
  for (int trial = 0; trial < 200; ++trial) {
    Chain c = chain(trial % 5);
    Eigen::Index parameters = 0;
    for (auto& j : c.joints) {
      const bool revolute = j.kind == JointKind::kRevolute;
      j.repeatability = 1e-3;
      j.direction_sigma_rad = random_() % 3 ? 3e-4 : 0;
      j.point_sigma_mm = random_() % 3 ? 0.05 : 0;
      parameters += (j.direction_sigma_rad > 0 ? 2 : 0) + (revolute && j.point_sigma_mm > 0 ? 2 : 0);
    }
    c.sensor_rotation_sigma_rad = random_() % 3 ? 2e-4 : 0;
    c.sensor_position_sigma_mm = random_() % 3 ? 0.02 : 0;
    parameters += (c.sensor_rotation_sigma_rad > 0 ? 3 : 0) + (c.sensor_position_sigma_mm > 0 ? 3 : 0);
    const std::vector<double> q = values(c);
    const UncertainPose uncertain = c.uncertain_part_from_sensor(q);
    ASSERT_EQ(uncertain.shared_factor.cols(), parameters) << "what is known exactly has no column";
    for (Eigen::Index k = 0; k < parameters; ++k) {
      const auto at = [&](double sigmas) {
        const Chain wrong = with_wrong_parameter(c, static_cast<size_t>(k), sigmas);
        return error_of(wrong.part_from_sensor(q), uncertain.mean);
      };
      const Vector6d numeric = (at(kStep) - at(-kStep)) / (2 * kStep),
                     column = uncertain.shared_factor.col(k);
      ASSERT_LT((numeric - column).norm(), 1e-5 * (1e-3 + column.norm())) << "parameter " << k;
    }
  }
}

TEST_F(ChainTest, AtZeroTheJointsGeometryDoesNotMatter) {
  Chain c = chain(4);
  for (auto& j : c.joints) j.direction_sigma_rad = j.point_sigma_mm = 1;
  EXPECT_LT(c.uncertain_part_from_sensor(std::vector<double>(4, 0.0)).shared().norm(), 1e-9);
}

TEST_F(ChainTest, OneValueForEachJointIsNeeded) {
  const Chain c = chain(3);
  EXPECT_THROW(c.part_from_sensor(std::vector<double>(2)), std::invalid_argument);
  EXPECT_THROW(c.part_from_sensor(std::vector<double>(4)), std::invalid_argument);
}

}  // namespace
}  // namespace gantry
