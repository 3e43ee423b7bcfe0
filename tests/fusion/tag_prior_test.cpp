#include "joint/tag_prior.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"
#include "gantry/kinematics/chain.h"
#include "joint/normal_equations.h"

namespace gantry {
namespace {

using internal::TagPrior;

constexpr double kDegree = std::numbers::pi / 180;

Eigen::MatrixXd gaussian(std::mt19937& random, Eigen::Index rows, Eigen::Index columns) {
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
}

/// Scans of which nothing but the tags is known.
std::vector<RangeSurface> tagged(const std::vector<UncertainPose>& tags) {
  std::vector<RangeSurface> scans;
  for (const UncertainPose& tag : tags) {
    scans.emplace_back();
    scans.back().name = "scan" + std::to_string(scans.size());
    scans.back().part_from_sensor = tag;
  }
  return scans;
}

/// Own errors of 0.1 mm and 0.1 mrad, shared ones three times that, all kinds of them correlated: large
/// against a millionth, small enough to be linear.
std::vector<RangeSurface> random_scans(std::mt19937& random, size_t count, Eigen::Index parameters) {
  std::vector<UncertainPose> tags(count);
  for (UncertainPose& tag : tags) {
    const Matrix6d root = 1e-4 * gaussian(random, 6, 6);
    tag.independent = root * root.transpose() + 1e-8 * Matrix6d::Identity();
    tag.shared_factor =
        3e-4 / std::sqrt(std::max(1.0, static_cast<double>(parameters))) * gaussian(random, 6, parameters);
    const Vector6d scale(1, 1, 1, 1000, 1000, 1000);
    tag.independent = scale.asDiagonal() * tag.independent * scale.asDiagonal();
    tag.shared_factor = scale.asDiagonal() * tag.shared_factor;
  }
  return tagged(tags);
}

/// Errors scaled so that radians and millimetres compare.
Eigen::MatrixXd in_mm(const Eigen::MatrixXd& covariance) {
  Eigen::VectorXd scale(covariance.rows());
  for (Eigen::Index k = 0; k < scale.size(); ++k) scale[k] = k % 6 < 3 ? 1000 : 1;
  return scale.asDiagonal() * covariance * scale.asDiagonal();
}

/// The covariance of all errors about the origin, as UncertainPose defines it.
Eigen::MatrixXd covariance_of(const std::vector<RangeSurface>& scans) {
  const auto rows = static_cast<Eigen::Index>(6 * scans.size());
  Eigen::MatrixXd own = Eigen::MatrixXd::Zero(rows, rows);
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(rows, scans[0].part_from_sensor.shared_factor.cols());
  for (size_t i = 0; i < scans.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(6 * i);
    own.block<6, 6>(at, at) = scans[i].part_from_sensor.independent;
    if (factor.cols() > 0) factor.middleRows<6>(at) = scans[i].part_from_sensor.shared_factor;
  }
  return own + factor * factor.transpose();
}

TEST(TagPrior, IsTheInverseOfTheWholeCovariance) {
  std::mt19937 random(1);
  for (const Eigen::Index parameters : {0, 1, 7, 40}) {
    const auto scans = random_scans(random, 4, parameters);
    const TagPrior prior(scans, Eigen::Vector3d::Zero());
    EXPECT_EQ(prior.parameters(), parameters);
    const Eigen::MatrixXd whole = in_mm(covariance_of(scans));
    const Eigen::MatrixXd product = in_mm(prior.information().inverse());
    EXPECT_LT((product - whole).norm(), 1e-4 * whole.norm()) << parameters;
    for (size_t i = 0; i < 4; ++i) {
      const Matrix6d marginal = in_mm(prior.information_of(i).inverse());
      const auto at = static_cast<Eigen::Index>(6 * i);
      EXPECT_LT((marginal - whole.block<6, 6>(at, at)).norm(), 1e-4 * marginal.norm());
    }
  }
}

TEST(TagPrior, SolvesALinearProblemAsTheExplicitInverseDoes) {
  // Three scans, pairs of them measured in some directions only; offsets from the tags.
  std::mt19937 random(2);
  const auto scans = random_scans(random, 3, 5);
  const TagPrior prior(scans, Eigen::Vector3d::Zero());
  const Eigen::VectorXd offset = 1e-2 * gaussian(random, 18, 1);
  internal::NormalEquations equations(3);
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(18, 18);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(18);
  for (const auto& [target, source] : {std::pair{0, 1}, {1, 2}}) {
    internal::PairSum sum;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d arm = 50 * random_direction(random), n = random_direction(random);
      const double r = 0.01 * k, weight = 1e4;
      sum.add(arm, n, r, weight);
      Eigen::VectorXd row = Eigen::VectorXd::Zero(18);
      row.segment<6>(6 * source) << arm.cross(n), n;
      row.segment<6>(6 * target) = -row.segment<6>(6 * source);
      hessian += weight * row * row.transpose();
      gradient += weight * r * row;
    }
    equations.add_pair(static_cast<size_t>(target), static_cast<size_t>(source), sum);
  }
  equations.add_prior(prior.information(), offset);
  const Eigen::MatrixXd information = covariance_of(scans).inverse();
  const Eigen::VectorXd expected = -(hessian + information).ldlt().solve(gradient + information * offset);
  EXPECT_LT((equations.solve() - expected).norm(), 1e-4 * expected.norm());
}

TEST(TagPrior, ErrorsAreAboutTheCentre) {
  std::mt19937 random(3);
  const auto scans = random_scans(random, 2, 3);
  const Eigen::Vector3d centre(120, -80, 40);
  const TagPrior about_origin(scans, Eigen::Vector3d::Zero()), about_centre(scans, centre);
  Eigen::VectorXd at_origin(12), at_centre(12);
  for (int i = 0; i < 2; ++i) {
    const Vector6d twist = 1e-5 * gaussian(random, 6, 1);
    at_origin.segment<6>(6 * i) = internal::log_about(Eigen::Vector3d::Zero(), pose_exp(twist));
    at_centre.segment<6>(6 * i) = internal::log_about(centre, pose_exp(twist));
  }
  const double a = at_origin.dot(about_origin.information() * at_origin),
               b = at_centre.dot(about_centre.information() * at_centre);
  EXPECT_NEAR(a, b, 1e-3 * a);
}

TEST(TagPrior, ChiSquareIsTakenApartIntoSharedAndOwn) {
  std::mt19937 random(4);
  for (const Eigen::Index parameters : {0, 6}) {
    const TagPrior prior(random_scans(random, 5, parameters), Eigen::Vector3d::Zero());
    const Eigen::VectorXd errors = 1e-4 * gaussian(random, 30, 1);
    const TagPrior::ChiSquare chi_square = prior.chi_square(errors);
    ASSERT_EQ(chi_square.own.size(), 5u);
    double sum = chi_square.shared;
    for (const double own : chi_square.own) sum += own;
    EXPECT_NEAR(sum, errors.dot(prior.information() * errors), 1e-6 * sum);
    EXPECT_EQ(chi_square.shared > 0, parameters > 0);
  }
}

TEST(TagPrior, TheWeakestDirectionIsBounded) {
  std::mt19937 random(5);
  const Vector6d unit(0.01, 0.01, 0.01, 1, 1, 1);
  for (const Eigen::Index parameters : {0, 2, 9}) {
    const TagPrior prior(random_scans(random, 4, parameters), Eigen::Vector3d::Zero());
    Eigen::VectorXd units(24);
    for (int i = 0; i < 4; ++i) units.segment<6>(6 * i) = unit;
    const Eigen::MatrixXd scaled = units.asDiagonal() * prior.information() * units.asDiagonal();
    const double smallest = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled).eigenvalues()(0);
    EXPECT_LE(prior.weakest(unit), smallest * 1.0001);
    EXPECT_GE(prior.weakest(unit), 0.4999 * smallest);
  }
}

/// A part on a rotary table that rides on a linear stage, as in the shipped cells.
Chain cell(double direction_sigma_rad, double point_sigma_mm) {
  Chain chain;
  Joint linear, rotation;
  linear.kind = JointKind::kPrismatic;
  linear.direction = Eigen::Vector3d::UnitX();
  linear.repeatability = 0.005;
  linear.direction_sigma_rad = direction_sigma_rad;
  rotation.point_mm = {0, -100, 0};
  rotation.repeatability = 0.002 * kDegree;
  rotation.direction_sigma_rad = direction_sigma_rad;
  rotation.point_sigma_mm = point_sigma_mm;
  chain.joints = {linear, rotation};
  chain.base_from_part_at_zero.translation() = Eigen::Vector3d(0, -100, 30);
  chain.base_from_sensor = looking_at({0, -500, 300}, {0, -100, 30});
  chain.sensor_rotation_sigma_rad = direction_sigma_rad;
  chain.sensor_position_sigma_mm = point_sigma_mm;
  return chain;
}

TEST(TagPrior, ErrorsOfMiscalibratedCellsHaveTheChiSquaresPromised) {
  // From well to badly calibrated: what is not linear must not look like an error of the tags.
  std::mt19937 random(6);
  std::normal_distribution<double> gauss;
  const auto across = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d {
    const double a = gauss(random), b = gauss(random);
    return a * v.unitOrthogonal() + b * v.cross(v.unitOrthogonal());
  };
  for (const double degrees : {0.003, 0.03, 0.3, 3.0}) {
    const Chain chain = cell(degrees * kDegree, 2 * degrees);
    constexpr int kCells = 200, kScans = 8;
    double shared = 0, own = 0, largest = 0;
    for (int draw = 0; draw < kCells; ++draw) {
      Chain truth = chain;
      for (Joint& j : truth.joints) {
        j.point_mm += j.point_sigma_mm * across(j.direction);
        j.direction = rotation_exp(j.direction_sigma_rad * across(j.direction)) * j.direction;
      }
      Vector6d mounting = gaussian(random, 6, 1);
      mounting.head<3>() *= chain.sensor_rotation_sigma_rad;
      mounting.tail<3>() *= chain.sensor_position_sigma_mm;
      truth.base_from_sensor = truth.base_from_sensor * pose_exp(mounting);
      std::vector<UncertainPose> tags;
      Eigen::VectorXd errors(6 * kScans);
      for (int i = 0; i < kScans; ++i) {
        std::vector<double> q = {100 * gauss(random), 2 * gauss(random)};
        tags.push_back(chain.uncertain_part_from_sensor(q));
        for (size_t k = 0; k < q.size(); ++k) q[k] += chain.joints[k].repeatability * gauss(random);
        errors.segment<6>(6 * i) = internal::log_about(
            Eigen::Vector3d::Zero(), truth.part_from_sensor(q) * tags.back().mean.inverse());
      }
      const TagPrior prior(tagged(tags), Eigen::Vector3d::Zero());
      ASSERT_EQ(prior.parameters(), 12);
      const TagPrior::ChiSquare chi_square = prior.chi_square(errors);
      shared += chi_square.shared / kCells;
      for (const double each : chi_square.own) {
        own += each / (kCells * kScans);
        largest = std::max(largest, each);
      }
    }
    EXPECT_LT(shared, 12) << degrees;
    EXPECT_GT(shared, 4) << degrees;
    // Two stages: at most two degrees of freedom are left to each scan.
    EXPECT_LT(own, 2.2) << degrees;
    EXPECT_LT(largest, 38) << degrees;
    EXPECT_GT(own, degrees < 0.1 ? 0.8 : 0) << degrees;
  }
}

TEST(TagPrior, ScansOfDifferentParametersAreRefused) {
  std::mt19937 random(7);
  auto scans = random_scans(random, 3, 4);
  const auto refused = [&](const std::vector<std::string>& parts) {
    expect_input_error([&] { TagPrior(scans, Eigen::Vector3d::Zero()); }, parts);
  };
  scans[2].part_from_sensor.shared_factor.conservativeResize(6, 3);
  refused({"scan3", "3 parameters", "scan1", "4"});
  scans[2].part_from_sensor.shared_factor.setConstant(6, 4, std::numeric_limits<double>::quiet_NaN());
  refused({"scan3", "not finite"});
  scans[2].part_from_sensor.shared_factor.setZero(6, 4);
  scans[2].part_from_sensor.calibration_id = "of another cell";
  refused({"scan3", "'of another cell'", "scan1"});
  scans[2].part_from_sensor.shared_factor.resize(6, 0);
  EXPECT_EQ(TagPrior(scans, Eigen::Vector3d::Zero()).parameters(), 4) << "it shares nothing with the others";
}

TEST(TagPrior, WhatIsNoCovarianceIsRefused) {
  UncertainPose good;
  good.independent = covariance_about({50, 0, 0}, 1, 0.01);
  const auto with = [&](auto&& spoil) {
    UncertainPose bad = good;
    spoil(bad.independent);
    return tagged({good, bad});
  };
  const auto expect_refused = [](const std::vector<RangeSurface>& scans) {
    expect_input_error([&] { TagPrior(scans, Eigen::Vector3d::Zero()); }, {"scan2", "symmetric"});
  };
  expect_refused(with([](Matrix6d& c) { c(1, 1) = -c(1, 1); }));
  expect_refused(with([](Matrix6d& c) { c.row(0).swap(c.row(4)); }));
  expect_refused(with([](Matrix6d& c) { c(3, 2) = std::numeric_limits<double>::quiet_NaN(); }));
  expect_refused(with([](Matrix6d& c) { c(0, 5) = c(5, 0) = 2 * std::sqrt(c(0, 0) * c(5, 5)); }));
  TagPrior(with([](Matrix6d& c) { c.setZero(); }), Eigen::Vector3d::Zero());  // exactly known
}

}  // namespace
}  // namespace gantry
