#include "uncertainty/pose_errors.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <functional>
#include <random>

#include "gantry/inspection/datums.h"
#include "inspection/samples.h"

namespace gantry::internal {
namespace {

const Eigen::Vector3f kLow(-30, -20, -10), kHigh(30, 20, 10);
constexpr Eigen::Index kScans = 4;

/// Errors of some micrometres, less than the noise, as registration leaves them; with much that scans share.
Eigen::MatrixXd pose_covariance(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd root(6 * kScans, 6 * kScans + 6);
  for (auto& value : root.reshaped()) value = normal(random);
  for (Eigen::Index k = 0; k < kScans; ++k) root.block<6, 6>(6 * k, 6 * kScans) += 5 * Matrix6d::Identity();
  for (Eigen::Index i = 0; i < root.rows(); ++i) root.row(i) *= i % 6 < 3 ? 0.00002 : 0.0008;
  return root * root.transpose();
}

/// The box's faces, each seen by one scan, and the top by two in different parts.
PointCloud scanned_box(std::mt19937& random) {
  PointCloud cloud = box_points(kLow, kHigh, 2, 0.02f);
  auto sources = std::make_shared<CloudSources>();
  sources->scans = {"a", "b", "c", "d"};
  sources->first.push_back(0);
  constexpr int kWhole = CloudSources::Share::kWhole;
  for (size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& n = cloud.normals[i];
    if (n.z() > 0.5f && cloud.points[i].x() > 0) {
      sources->shares.push_back({1, kWhole / 4});
      sources->shares.push_back({3, kWhole - kWhole / 4});
    } else {
      sources->shares.push_back({static_cast<uint16_t>(n.z() > 0.5f ? 0
                                                       : n.x() != 0 ? 1
                                                       : n.y() > 0  ? 2
                                                                    : 3),
                                 kWhole});
    }
    sources->first.push_back(static_cast<uint32_t>(sources->shares.size()));
  }
  sources->pose_covariance = pose_covariance(random);
  cloud.sources = sources;
  return cloud;
}

/// The cloud as it is when the scans' poses are wrong by `error`.
PointCloud displaced(const PointCloud& cloud, const Eigen::VectorXd& error) {
  PointCloud moved = cloud;
  for (size_t i = 0; i < cloud.size(); ++i)
    for (const auto& share : cloud.sources->of(i)) {
      const Vector6d e = error.segment<6>(6 * share.scan);
      const Eigen::Vector3d shift = e.head<3>().cross(cloud.points[i].cast<double>()) + e.tail<3>();
      moved.points[i] += (share.fraction() * shift).cast<float>();
    }
  return moved;
}

/// What errors drawn from the covariance do to the deviations, against what PoseErrors predicts.
void expect_predicted(const std::function<AlignmentResult(const PointCloud&, const SignedDistance&)>& align) {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const SignedDistance model(box_mesh(kLow, kHigh));
  const PointCloud cloud = scanned_box(random);
  const Eigen::MatrixXd root = Eigen::LLT<Eigen::MatrixXd>(cloud.sources->pose_covariance).matrixL();
  const AlignmentResult undisturbed = align(cloud, model);
  const PoseErrors predicted(*cloud.sources, undisturbed);
  const auto deviation = [&](const PointCloud& of, size_t i, const Pose& pose) {
    return model((pose * of.points[i].cast<double>()).cast<float>(), cloud.normals[i], 0.5f, 5)->distance;
  };
  constexpr int kDraws = 250;
  std::vector<double> squares(cloud.size(), 0);
  for (int draw = 0; draw < kDraws; ++draw) {
    Eigen::VectorXd z(6 * kScans);
    for (double& value : z) value = normal(random);
    const PointCloud moved = displaced(cloud, root * z);
    const Pose pose = align(moved, model).cad_from_cloud;
    for (size_t i = 0; i < cloud.size(); ++i) {
      const double change = deviation(moved, i, pose) - deviation(cloud, i, undisturbed.cad_from_cloud);
      squares[i] += change * change / kDraws;
    }
  }
  double shown = 0, stated = 0;
  size_t far = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    Vector6d row;
    row << cloud.points[i].cross(cloud.normals[i]).cast<double>(), cloud.normals[i].cast<double>();
    const double variance = predicted.variance(cloud.sources->of(i), row);
    shown += squares[i];
    stated += variance;
    far += squares[i] < 0.6 * variance || squares[i] > 1.6 * variance;
  }
  EXPECT_NEAR(shown / stated, 1, 0.12);
  EXPECT_LT(far, cloud.size() / 20);
}

TEST(PoseErrors, AreCarriedToPointsThatAreTakenAsTheyStand) {
  expect_predicted([](const PointCloud&, const SignedDistance&) { return AlignmentResult{}; });
}

TEST(PoseErrors, AreCarriedThroughTheBestFit) {
  expect_predicted([](const PointCloud& cloud, const SignedDistance& model) {
    AlignmentOptions options;
    options.samples = 1500;
    return align_to_model(cloud, model, options);
  });
}

TEST(PoseErrors, AreCarriedThroughDatums) {
  const auto plane = [](const char* name, const Eigen::Vector3d& at, const Eigen::Vector3d& normal,
                        double radius) {
    Datum datum;
    datum.name = name;
    datum.kind = DatumKind::kPlane;
    datum.position_mm = at;
    datum.normal = normal;
    datum.radius_mm = radius;
    return datum;
  };
  DatumSet set;
  set.name = "box";
  set.datums = {plane("A", {0, 0, 10}, {0, 0, 1}, 18), plane("B", {0, 20, 0}, {0, 1, 0}, 15),
                plane("C", {30, 0, 0}, {1, 0, 0}, 9)};
  expect_predicted([&](const PointCloud& cloud, const SignedDistance& model) {
    AlignmentOptions options;
    options.samples = 1500;
    return align_to_datums(cloud, model, set, align_to_model(cloud, model, options), options);
  });
}

TEST(PoseErrors, WhatAllScansShareIsTakenUpByTheAlignment) {
  std::mt19937 random(2);
  const SignedDistance model(box_mesh(kLow, kHigh));
  PointCloud cloud = scanned_box(random);
  auto sources = std::make_shared<CloudSources>(*cloud.sources);
  for (Eigen::Index i = 0; i < kScans; ++i)
    for (Eigen::Index j = 0; j < kScans; ++j)
      sources->pose_covariance.block<6, 6>(6 * i, 6 * j) = 1e-4 * Matrix6d::Identity();
  cloud.sources = sources;
  const AlignmentResult fit = align_to_model(cloud, model, {});
  ASSERT_EQ(fit.scan_influence.size(), static_cast<size_t>(kScans));
  Matrix6d all = Matrix6d::Zero();
  for (const Matrix6d& influence : fit.scan_influence) all += influence;
  EXPECT_TRUE(all.isApprox(Matrix6d::Identity(), 1e-3)) << all;
  const PoseErrors aligned(*sources, fit), as_it_stands(*sources, {});
  for (size_t i = 0; i < cloud.size(); i += 50) {
    Vector6d row;
    row << cloud.points[i].cross(cloud.normals[i]).cast<double>(), cloud.normals[i].cast<double>();
    EXPECT_LT(aligned.variance(sources->of(i), row), 1e-4 * as_it_stands.variance(sources->of(i), row));
    EXPECT_NEAR(as_it_stands.variance(sources->of(i), row), 1e-4 * row.squaredNorm(),
                1e-6 * row.squaredNorm());
  }
}

TEST(PoseErrors, WithoutCovarianceAreZero) {
  std::mt19937 random(2);
  PointCloud cloud = scanned_box(random);
  CloudSources sources = *cloud.sources;
  sources.pose_covariance.resize(0, 0);
  EXPECT_EQ(PoseErrors(sources, {}).variance(sources.of(0), Vector6d::Ones()), 0);
  EXPECT_EQ(PoseErrors().variance(sources.of(0), Vector6d::Ones()), 0);
}

}  // namespace
}  // namespace gantry::internal
