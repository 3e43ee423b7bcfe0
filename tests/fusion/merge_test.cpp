#include "gantry/fusion/merge.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <random>

#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

constexpr double kPitch = 0.5;

/// A scan by parallel rays every 0.5 mm, none on the border of a cell of 1 mm: pixel (c, r) lies at
/// ((c + 0.5) / 2, (r + 0.5) / 2, height(x, y)), its normal as given.
RangeSurface sheet(int width, int height, double sigma_mm, const std::function<double(double, double)>& z,
                   const Eigen::Vector3f& normal = Eigen::Vector3f::UnitZ()) {
  RangeSurface s;
  s.name = "sheet";
  s.rays.central = false;
  s.rays.ray_of_pixel.col(0).setConstant(kPitch / 2);
  s.rays.ray_of_pixel(0, 1) = s.rays.ray_of_pixel(1, 2) = kPitch;
  s.width = width;
  s.height = height;
  for (int r = 0; r < height; ++r)
    for (int c = 0; c < width; ++c) s.w.push_back(static_cast<float>(z((c + 0.5) / 2, (r + 0.5) / 2)));
  s.normals.assign(s.w.size(), pack_normal(normal.normalized()));
  s.flags.assign(s.w.size(), RangeSurface::kUsable);
  s.noise_scale = s.noise_mm = sigma_mm;
  s.spacing_mm = kPitch;
  s.usable = s.w.size();
  return s;
}

/// A square of 20 mm at height z.
RangeSurface square(double z, double sigma_mm, float normal_z = 1) {
  return sheet(40, 40, sigma_mm, [z](double, double) { return z; }, {0, 0, normal_z});
}

/// A sphere of 30 mm about the origin from 500 mm away, as a camera sees it; with noise along the normal.
constexpr double kRadius = 30;
RangeSurface ball(double noise_mm, unsigned seed) {
  RangeSurface s;
  s.name = "ball";
  constexpr double kFocal = 1000;
  s.width = s.height = 120;
  s.rays.ray_of_pixel.col(0).setConstant(-59.5 / kFocal);
  s.rays.ray_of_pixel(0, 1) = s.rays.ray_of_pixel(1, 2) = 1 / kFocal;
  s.sensor_from_grid.translation().z() = -500;
  const Eigen::Vector3d centre(0, 0, 500);
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, noise_mm);
  for (int r = 0; r < s.height; ++r)
    for (int c = 0; c < s.width; ++c) {
      const Eigen::Vector3d ray = s.rays.ray(c, r).homogeneous().normalized();
      const double b = ray.dot(centre), under_root = b * b - centre.squaredNorm() + kRadius * kRadius;
      const double distance = b - std::sqrt(std::max(under_root, 0.0));
      const Eigen::Vector3d n = (distance * ray - centre) / kRadius;
      const bool seen = under_root > 0 && -n.dot(ray) > 0.3;
      s.w.push_back(seen ? static_cast<float>(1 / ((distance - noise(random) / n.dot(ray)) * ray.z())) : 0);
      s.normals.push_back(pack_normal(n.cast<float>()));
    }
  s.noise_scale = noise_mm / (470.0 * 470.0);
  s.spacing_mm = 0.47;
  return s;
}

/// Turns about the origin of the part, in which the ball lies.
std::vector<Pose> turns(size_t count) {
  std::vector<Pose> poses(count, Pose::Identity());
  for (size_t k = 0; k < count; ++k) poses[k].linear() = rotation_exp({0.2, 0.4 * static_cast<double>(k), 0});
  return poses;
}

PointCloud merge(const std::vector<RangeSurface>& surfaces, const std::vector<Pose>& poses,
                 const MergeOptions& options, MergeReport* report = nullptr) {
  return merge_surfaces(surfaces, poses, options, report);
}

MergeOptions cells_of(double voxel_mm) {
  MergeOptions options;
  options.voxel_mm = voxel_mm;
  return options;
}

const Pose kHere = Pose::Identity();

TEST(Merge, NothingGivesNothing) {
  MergeReport report;
  report.points = 7;
  EXPECT_EQ(merge({}, {}, {}, &report).size(), 0u);
  EXPECT_EQ(report.points, 0u);
  RangeSurface blank = square(0.4, 0.02);
  std::fill(blank.w.begin(), blank.w.end(), 0.0f);
  EXPECT_EQ(merge({blank}, {kHere}, {}).size(), 0u);
}

TEST(Merge, OffsetPlanesBecomeTheirWeightedMean) {
  // Weights 9 to 1.
  const PointCloud merged = merge({square(0.4, 0.02), square(0.5, 0.06)}, {kHere, kHere}, cells_of(1));
  ASSERT_EQ(merged.size(), 400u);
  const double weight = 4 / (0.02 * 0.02) + 4 / (0.06 * 0.06);
  for (size_t i = 0; i < merged.size(); ++i) {
    EXPECT_NEAR(merged.points[i].z(), 0.41, 1e-4);
    EXPECT_NEAR(merged.sigma_mm[i], 1 / std::sqrt(weight), 1e-6);
    EXPECT_LT((merged.normals[i] - Eigen::Vector3f::UnitZ()).norm(), 1e-4f);
  }
}

TEST(Merge, EveryPointIsTheWeightedMeanOfItsCell) {
  std::vector<RangeSurface> scans;
  for (unsigned k = 0; k < 5; ++k) scans.push_back(ball(0.02 * (k + 1), k));
  const std::vector<Pose> poses = turns(scans.size());
  constexpr double kCell = 2;
  struct Sum {
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    double weight = 0;
    size_t count = 0;
  };
  std::map<std::array<int, 3>, Sum> expected;
  for (size_t k = 0; k < scans.size(); ++k)
    for (int r = 0; r < scans[k].height; ++r)
      for (int c = 0; c < scans[k].width; ++c) {
        if (scans[k].w[scans[k].index(c, r)] == 0) continue;
        const Eigen::Vector3d in_grid = scans[k].point(c, r);
        const Eigen::Vector3d p = poses[k] * scans[k].sensor_from_grid * in_grid;
        Sum& sum = expected[{static_cast<int>(std::floor(p.x() / kCell)),
                             static_cast<int>(std::floor(p.y() / kCell)),
                             static_cast<int>(std::floor(p.z() / kCell))}];
        const double w = 1 / std::pow(scans[k].sigma_mm(in_grid), 2);
        sum.point += w * p;
        sum.weight += w;
        ++sum.count;
      }
  MergeOptions options = cells_of(kCell);
  options.correlated_share = 0.1;
  MergeReport report;
  const PointCloud merged = merge(scans, poses, options, &report);
  EXPECT_EQ(report.cells, expected.size());
  size_t same = 0;
  for (size_t i = 0; i < merged.size(); ++i) {
    const Eigen::Vector3d p = merged.points[i].cast<double>();
    const auto found = expected.find({static_cast<int>(std::floor(p.x() / kCell)),
                                      static_cast<int>(std::floor(p.y() / kCell)),
                                      static_cast<int>(std::floor(p.z() / kCell))});
    if (found == expected.end()) continue;
    const Sum& sum = found->second;
    if ((p - sum.point / sum.weight).norm() > 2e-3) continue;
    const double sigma = std::sqrt(std::max(1.0, 0.1 * static_cast<double>(sum.count)) / sum.weight);
    same += std::abs(merged.sigma_mm[i] / sigma - 1) < 1e-3;
  }
  // A duplicate takes two of them away.
  EXPECT_GE(same + 2 * report.duplicates + report.unsupported + report.contradicted, expected.size());
  EXPECT_GT(same, expected.size() / 2);
}

TEST(Merge, SharesAreTheWeightsOfTheScans) {
  // Squares of 20 mm, each 5 mm further along x and less certain than the one before.
  std::vector<RangeSurface> scans;
  std::vector<Pose> poses;
  for (int k = 0; k < 3; ++k) {
    scans.push_back(square(0.5, 0.02 * (k + 1)));
    scans.back().name = "scan " + std::to_string(k);
    poses.push_back(Pose(Eigen::Translation3d(5 * k, 0, 0)));
  }
  MergeOptions options;
  options.voxel_mm = 1;
  options.correlated_share = 0;
  const PointCloud cloud = merge(scans, poses, options);
  ASSERT_TRUE(cloud.sources);
  EXPECT_EQ(cloud.sources->scans, (std::vector<std::string>{"scan 0", "scan 1", "scan 2"}));
  ASSERT_EQ(cloud.sources->points(), cloud.size());
  size_t of_three = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    std::map<int, double> expected;
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
      if (cloud.points[i].x() < 5 * k || cloud.points[i].x() > 5 * k + 20) continue;
      sum += expected[k] = 4 / std::pow(0.02 * (k + 1), 2);  // four pixels a cell
    }
    const auto shares = cloud.sources->of(i);
    ASSERT_EQ(shares.size(), expected.size()) << cloud.points[i].transpose();
    for (size_t s = 0; s < shares.size(); ++s) {
      if (s > 0) {
        ASSERT_LT(shares[s - 1].scan, shares[s].scan);
      }
      ASSERT_NEAR(shares[s].fraction(), expected[shares[s].scan] / sum, 2e-5);
    }
    ASSERT_NEAR(cloud.sigma_mm[i], 1 / std::sqrt(sum), 1e-5);
    of_three += shares.size() == 3;
  }
  EXPECT_EQ(of_three, 200u);
}

TEST(Merge, DuplicatesBringTheirScansAlong) {
  // A surface along a border of cells: noise puts each scan's points on one side or the other.
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.05);
  std::vector<RangeSurface> scans;
  for (int k = 0; k < 4; ++k)
    scans.push_back(sheet(40, 40, 0.05, [&](double, double) { return noise(random); }));
  MergeOptions options;
  options.voxel_mm = 1;
  options.correlated_share = 0;
  MergeReport report;
  const PointCloud cloud = merge(scans, std::vector<Pose>(4, kHere), options, &report);
  EXPECT_GT(report.duplicates, 300u);
  for (size_t i = 0; i < cloud.size(); ++i) {
    double sum = 0;
    const auto shares = cloud.sources->of(i);
    for (size_t s = 0; s < shares.size(); ++s) {
      if (s > 0) {
        ASSERT_LT(shares[s - 1].scan, shares[s].scan);
      }
      sum += shares[s].fraction();
    }
    ASSERT_NEAR(sum, 1, 1e-4);
  }
  // 16 measurements to nearly every point, four of each scan.
  std::map<size_t, size_t> by_scans;
  for (size_t i = 0; i < cloud.size(); ++i) ++by_scans[cloud.sources->of(i).size()];
  EXPECT_GT(by_scans[4], cloud.size() * 9 / 10);
}

TEST(Merge, PosesCarryPointsAndNormals) {
  Pose turned = Pose::Identity();
  turned.linear() = rotation_exp({0, std::numbers::pi / 2, 0});
  turned.translation() = Eigen::Vector3d(3, 0, 0);
  const PointCloud merged = merge({square(0.4, 0.02)}, {turned}, cells_of(1));
  ASSERT_GT(merged.size(), 0u);
  for (size_t i = 0; i < merged.size(); ++i) {
    EXPECT_NEAR(merged.points[i].x(), 3.4, 1e-4);
    EXPECT_LT((merged.normals[i] - Eigen::Vector3f::UnitX()).norm(), 1e-4f);
  }
}

TEST(Merge, FacesOfAThinWallStayApart) {
  // The wall of 1 mm lies within the cells; and across their border, nearer than what makes duplicates.
  for (const double z : {0.4, 1.7}) {
    const PointCloud merged =
        merge({square(z + 0.5, 0.02), square(z, 0.02, -1)}, {kHere, kHere}, cells_of(2));
    EXPECT_EQ(merged.size(), 200u);
    for (size_t i = 0; i < merged.size(); ++i)
      EXPECT_NEAR(merged.points[i].z(), merged.normals[i].z() > 0 ? z + 0.5 : z, 2e-4);
  }
}

TEST(Merge, FacesOfAnEdgeStayApart) {
  const PointCloud merged =
      merge({square(0.4, 0.02), sheet(40, 40, 0.02, [](double, double) { return 0.4; }, {1, 0, 0.3f})},
            {kHere, kHere}, cells_of(1));
  EXPECT_EQ(merged.size(), 800u);
}

TEST(Merge, SurfaceAlongABorderIsNotDoubled) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.05);
  std::vector<RangeSurface> scans;
  for (int k = 0; k < 10; ++k)
    scans.push_back(sheet(60, 60, 0.05, [&](double, double) { return 3 + noise(random); }));
  MergeReport report;
  const PointCloud merged = merge(scans, std::vector<Pose>(10, kHere), cells_of(1), &report);
  EXPECT_EQ(report.cells, 1800u);
  EXPECT_EQ(merged.size(), 900u);
  double worst = 0;
  for (size_t i = 0; i < merged.size(); ++i) {
    worst = std::max(worst, std::abs(merged.points[i].z() - 3.0));
    EXPECT_NEAR(merged.sigma_mm[i], 0.05 * 0.2, 1e-5);  // 40 measurements: the floor, not 0.05 / sqrt(40)
  }
  EXPECT_LT(worst, 5 * 0.05 / std::sqrt(40));
}

TEST(Merge, LonePointsAreDropped) {
  RangeSurface surface = square(0.4, 0.02);
  surface.w[surface.index(10, 10)] = 9;
  RangeSurface far = square(0.4, 0.02);
  std::fill(far.w.begin(), far.w.end() - 1, 0.0f);
  Pose aside = Pose::Identity();
  aside.translation().x() = -90;
  MergeOptions options = cells_of(1);
  MergeReport report;
  EXPECT_EQ(merge({surface, far}, {kHere, aside}, options, &report).size(), 400u);
  EXPECT_EQ(report.unsupported, 2u);
  options.min_support = 1;
  EXPECT_EQ(merge({surface, far}, {kHere, aside}, options).size(), 402u);
}

TEST(Merge, WhatContradictsSeveralScansIsDropped) {
  std::vector<RangeSurface> scans(3, square(0.4, 0.02));
  // A mixed pixel in the next cell above the surface, which so has support, seen once.
  scans[1].w[scans[1].index(20, 20)] = 1.2f;
  MergeReport report;
  PointCloud merged = merge(scans, std::vector<Pose>(3, kHere), cells_of(1), &report);
  EXPECT_EQ(report.contradicted, 1u);
  EXPECT_EQ(merged.size(), 400u);
  // What noise explains stays,
  for (auto& scan : scans) scan.noise_scale = 0.3;
  EXPECT_EQ(merge(scans, std::vector<Pose>(3, kHere), cells_of(1)).size(), 401u);
  for (auto& scan : scans) scan.noise_scale = 0.02;
  // and what only one other scan saw is no agreement.
  EXPECT_EQ(merge({scans[1]}, {kHere}, cells_of(1)).size(), 401u);
}

TEST(Merge, CrestThatOneScanSeesSurvives) {
  // A burr of one pixel row, 0.8 mm high, on a face on which the others, from elsewhere, agree.
  std::vector<RangeSurface> scans(3, square(0.4, 0.02));
  for (int c = 0; c < 40; ++c) scans[0].w[scans[0].index(c, 20)] = 1.2f;
  const PointCloud merged = merge(scans, std::vector<Pose>(3, kHere), cells_of(1));
  size_t crest = 0;
  for (const auto& p : merged.points) crest += std::abs(p.z() - 1.2f) < 1e-3f;
  EXPECT_EQ(crest, 20u);
}

TEST(Merge, FarFromTheOriginNothingIsLost) {
  const std::vector<RangeSurface> scans = {ball(0.02, 1), ball(0.02, 2)};
  std::vector<Pose> near = turns(2), far = near;
  const Eigen::Vector3d shift(10000, -10000, 9984);  // whole numbers of cells
  for (Pose& pose : far) pose.translation() += shift;
  const PointCloud a = merge(scans, near, cells_of(0.5)), b = merge(scans, far, cells_of(0.5));
  ASSERT_GT(a.size(), 5000u);
  ASSERT_EQ(a.size(), b.size());
  // The order follows the place in space, so compare as sets: of distances from the ball's middle.
  const auto off_ball = [](const PointCloud& cloud, const Eigen::Vector3d& middle) {
    std::vector<double> off;
    for (const auto& p : cloud.points) off.push_back((p.cast<double>() - middle).norm() - kRadius);
    std::sort(off.begin(), off.end());
    return off;
  };
  const std::vector<double> off_a = off_ball(a, Eigen::Vector3d::Zero()), off_b = off_ball(b, shift);
  constexpr double kFloatStep = 1e-3;  // of coordinates of 10 m
  for (size_t i = 0; i < off_a.size(); ++i) ASSERT_NEAR(off_a[i], off_b[i], kFloatStep);
}

TEST(Merge, ManyScansLeaveNoBias) {
  std::vector<RangeSurface> scans;
  for (unsigned k = 0; k < 12; ++k) scans.push_back(ball(0.05, k));
  const PointCloud merged = merge(scans, turns(12), {});
  double sum = 0, squares = 0;
  for (size_t i = 0; i < merged.size(); ++i) {
    const double off = merged.points[i].cast<double>().norm() - kRadius;
    sum += off;
    squares += std::pow(off / merged.sigma_mm[i], 2);
  }
  const auto n = static_cast<double>(merged.size());
  EXPECT_LT(std::abs(sum / n), 2e-3);
  EXPECT_NEAR(std::sqrt(squares / n), 1, 0.25);
}

TEST(Merge, UniformDensityKeepsItsDistanceAndLeavesNoHoles) {
  std::vector<RangeSurface> scans;
  for (unsigned k = 0; k < 8; ++k) scans.push_back(ball(0.02, k));
  MergeOptions options = cells_of(1);
  const PointCloud all = merge(scans, turns(8), options);
  options.uniform_density = true;
  MergeReport report;
  const PointCloud even = merge(scans, turns(8), options, &report);
  EXPECT_EQ(even.size() + report.thinned, all.size());
  size_t close = 0, lonely = 0, inside = 0;
  for (const auto& p : even.points) {
    size_t around = 0;
    for (const auto& q : even.points) {
      const float d = (p - q).norm();
      close += d > 0 && d < 0.69f;
      around += d > 0 && d < 2.0f;
    }
    lonely += around == 0;
  }
  EXPECT_LT(close, even.size() / 200);
  EXPECT_EQ(lonely, 0u);
  // About one to the square of a cell, wherever one looks: a patch of 6 mm radius well inside the data, at
  // slopes from 0 to 45 degrees to the cells.
  const Pose turn = turns(8)[4];
  for (const double tilt : {0.0, 0.2, 0.35, 0.5, 0.6, 0.7}) {
    const Eigen::Vector3d middle =
        kRadius * (turn.linear() * Eigen::Vector3d(std::sin(tilt), 0, -std::cos(tilt)));
    inside = 0;
    for (const auto& p : even.points) inside += (p.cast<double>() - middle).norm() < 6;
    const double density = static_cast<double>(inside) / (std::numbers::pi * 36);
    EXPECT_GT(density, 0.75) << "tilt " << tilt;
    EXPECT_LT(density, 1.1) << "tilt " << tilt;
  }
}

TEST(Merge, MemoryFollowsTheSurfaceAndTwelveBytesAScan) {
  std::vector<RangeSurface> scans(3, ball(0.02, 3));
  MergeReport few, many;
  merge({scans[0]}, {kHere}, {}, &few);
  scans.resize(30, scans[0]);
  merge(scans, std::vector<Pose>(30, kHere), {}, &many);
  EXPECT_EQ(many.measurements, 30 * few.measurements);
  EXPECT_EQ(many.cells, few.cells);
  EXPECT_EQ(many.memory_bytes, few.memory_bytes + 12 * 29 * few.cells);
  const size_t scratch = 28 * scans[0].w.size(), tables = 64 * 256 * 4;
  EXPECT_LT(few.memory_bytes - scratch - tables, 80 * few.cells);
}

TEST(Merge, ScanByScanIsTheSame) {
  const std::vector<RangeSurface> scans = {ball(0.02, 1), ball(0.02, 2), ball(0.05, 3)};
  const PointCloud at_once = merge(scans, turns(3), {});
  CloudMerger merger({});
  for (int round = 0; round < 2; ++round) {  // and it starts anew after finish()
    for (size_t k = 0; k < scans.size(); ++k) merger.add(scans[k], turns(3)[k]);
    const PointCloud one_by_one = merger.finish();
    EXPECT_EQ(at_once.points, one_by_one.points);
    EXPECT_EQ(at_once.sigma_mm, one_by_one.sigma_mm);
  }
  MergeReport report;
  RangeSurface coarse = scans[0];
  coarse.spacing_mm = 1;
  merger.add(coarse, kHere);
  merger.finish(&report);
  EXPECT_DOUBLE_EQ(report.voxel_mm, 1.1);
}

TEST(Merge, CellSizeComesFromTheSpacingUnlessGiven) {
  MergeReport report;
  std::vector<RangeSurface> scans(3, square(0.4, 0.02));
  scans[0].spacing_mm = 7;
  merge(scans, std::vector<Pose>(3, kHere), {}, &report);
  EXPECT_DOUBLE_EQ(report.voxel_mm, 1.1 * 0.5);
  merge(scans, std::vector<Pose>(3, kHere), cells_of(2), &report);
  EXPECT_DOUBLE_EQ(report.voxel_mm, 2);
}

TEST(Merge, ThreadsDoNotChangeTheResult) {
  std::vector<RangeSurface> scans;
  for (unsigned k = 0; k < 6; ++k) scans.push_back(ball(0.1, k));
  for (const bool uniform : {false, true}) {
    MergeOptions options;
    options.uniform_density = uniform;
    std::vector<PointCloud> results;
    for (const size_t threads : {1, 2}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      results.push_back(merge(scans, turns(6), options));
    }
    ASSERT_GT(results[0].size(), 1000u);
    EXPECT_EQ(results[0].points, results[1].points);
    EXPECT_EQ(results[0].normals, results[1].normals);
    EXPECT_EQ(results[0].sigma_mm, results[1].sigma_mm);
  }
}

TEST(Merge, BadInputIsNamed) {
  const std::vector<RangeSurface> scans = {square(0.4, 0.02)};
  expect_input_error([&] { merge(scans, {}, {}); }, {"1 scans", "0 poses"});
  expect_input_error([&] { merge(scans, {kHere}, cells_of(-1)); }, {"voxel_mm", "-1"});
  expect_input_error([&] { merge(scans, {kHere}, cells_of(std::nan(""))); }, {"voxel_mm"});
  expect_input_error([&] { merge(scans, {kHere}, cells_of(1e-6)); }, {"scan sheet", "voxel_mm"});
  MergeOptions share;
  share.correlated_share = 1.5;
  expect_input_error([&] { merge(scans, {kHere}, share); }, {"correlated_share"});
  Pose lost = kHere;
  lost.translation().x() = std::nan("");
  expect_input_error([&] { merge(scans, {lost}, {}); }, {"scan sheet", "pose"});
  std::vector<RangeSurface> unknown = scans;
  unknown[0].spacing_mm = 0;
  expect_input_error([&] { merge(unknown, {kHere}, {}); }, {"spacing", "voxel_mm"});
}

}  // namespace
}  // namespace gantry
