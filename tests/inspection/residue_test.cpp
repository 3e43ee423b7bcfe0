#include "defects/residue.h"

#include <gtest/gtest.h>

#include <cmath>

#include "gantry/inspection/inspection.h"
#include "inspection/samples.h"

namespace gantry {
namespace {

using internal::kManyScans;
using internal::ResidueFinder;

constexpr double kToleranceMm = 0.2;
const Eigen::Vector3f kLow(-30, -20, -20), kHigh(30, 20, 0);

/// Points of a block, measured by three scans in turn; `off` is what scan 1 lies off by at each point.
class ResidueOfABlock : public testing::Test {
 protected:
  ResidueOfABlock() : cloud_(box_points(kLow, kHigh, 0.6f, 0.03f)) {
    for (size_t i = 0; i < cloud_.size(); ++i) {
      normal_.push_back(cloud_.normals[i]);
      Eigen::Index axis;
      normal_.back().cwiseAbs().maxCoeff(&axis);
      Eigen::Vector3f foot = cloud_.points[i];
      foot[axis] = normal_.back()[axis] > 0 ? kHigh[axis] : kLow[axis];
      deviation_.push_back((cloud_.points[i] - foot).dot(normal_.back()));
      foot_.push_back(foot);
      scan_.push_back(static_cast<uint16_t>(i % 3));
    }
  }

  void move_scan_1(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
    for (size_t i = 0; i < scan_.size(); ++i)
      if (scan_[i] == 1)
        deviation_[i] += static_cast<float>(
            (rotation.cross(foot_[i].cast<double>()) + translation).dot(normal_[i].cast<double>()));
  }

  /// On the top, within `radius` of a place; those out of tolerance only.
  std::vector<size_t> members(float x, float y, float radius) const {
    std::vector<size_t> found;
    for (size_t i = 0; i < scan_.size(); ++i)
      if (normal_[i].z() > 0.5f && std::hypot(foot_[i].x() - x, foot_[i].y() - y) < radius &&
          std::abs(deviation_[i]) > kToleranceMm)
        found.push_back(i);
    return found;
  }

  void dent(float x, float y, float radius, float depth) {
    for (size_t i = 0; i < scan_.size(); ++i)
      if (normal_[i].z() > 0.5f && std::hypot(foot_[i].x() - x, foot_[i].y() - y) < radius)
        deviation_[i] -= depth;
  }

  ResidueFinder finder() const { return ResidueFinder({foot_, normal_, deviation_, scan_}, kToleranceMm); }

  PointCloud cloud_;
  std::vector<Eigen::Vector3f> foot_, normal_;
  std::vector<float> deviation_;
  std::vector<uint16_t> scan_;
};

TEST_F(ResidueOfABlock, TheScanThatWasMovedExplainsItsRegion) {
  move_scan_1({0.01, -0.004, 0.002}, {0.05, -0.02, 0.3});
  const ResidueFinder residue = finder();
  const std::vector<size_t> region = members(10, 5, 8);
  ASSERT_GT(region.size(), 50u);
  const auto scan = residue.scan_that_explains(region);
  ASSERT_TRUE(scan);
  EXPECT_EQ(*scan, 1u);
  // The rotation does not depend on the point that it is about.
  EXPECT_LT((residue.motions()[1].twist.head<3>() - Eigen::Vector3d(0.01, -0.004, 0.002)).norm(), 5e-4);
}

TEST_F(ResidueOfABlock, ADentThatAllScansSawIsNone) {
  dent(10, 5, 6, 0.5f);
  EXPECT_FALSE(finder().scan_that_explains(members(10, 5, 8)));
  // Also when a scan lies off besides.
  move_scan_1({0, 0, 0}, {0, 0, 0.3});
  const ResidueFinder residue = finder();
  EXPECT_FALSE(residue.scan_that_explains(members(10, 5, 5)));
  EXPECT_TRUE(residue.scan_that_explains(members(-20, -10, 6)));
}

TEST_F(ResidueOfABlock, WhatOneScanAloneSawIsNone) {
  // Nobody contradicts: the others did not look there.
  for (size_t i = 0; i < scan_.size(); ++i)
    if (normal_[i].z() > 0.5f && std::hypot(foot_[i].x() - 10, foot_[i].y() - 5) < 12) scan_[i] = 1;
  dent(10, 5, 6, 0.5f);
  EXPECT_FALSE(finder().scan_that_explains(members(10, 5, 8)));
}

TEST_F(ResidueOfABlock, ADefectOfOneScanThatNoMotionExplainsIsNone) {
  for (size_t i = 0; i < scan_.size(); ++i)
    if (scan_[i] == 1 && normal_[i].z() > 0.5f && std::hypot(foot_[i].x() - 10, foot_[i].y() - 5) < 5)
      deviation_[i] += 0.5f;
  EXPECT_FALSE(finder().scan_that_explains(members(10, 5, 8)));
}

TEST_F(ResidueOfABlock, WithoutScansThereIsNone) {
  move_scan_1({0, 0, 0}, {0, 0, 0.3});
  scan_.assign(scan_.size(), kManyScans);
  EXPECT_FALSE(finder().scan_that_explains(members(10, 5, 8)));
}

/// Two scans in stripes of 3 mm across the block, the second one too high by `off`.
PointCloud striped(float off, float bump_mm) {
  PointCloud cloud = box_points(kLow, kHigh, 0.4f, 0.02f);
  auto sources = std::make_shared<CloudSources>();
  sources->scans = {"front", "back"};
  sources->first.push_back(0);
  for (size_t i = 0; i < cloud.size(); ++i) {
    const auto scan = static_cast<uint16_t>(static_cast<int>(std::floor((cloud.points[i].x() + 30) / 3)) % 2);
    sources->shares.push_back({scan, CloudSources::Share::kWhole});
    sources->first.push_back(static_cast<uint32_t>(i + 1));
    if (cloud.normals[i].z() > 0.5f && cloud.points[i].head<2>().norm() < 8) cloud.points[i].z() += bump_mm;
    if (scan == 1) cloud.points[i].z() += off;
  }
  cloud.sources = sources;
  return cloud;
}

TEST(RegistrationResidue, IsShownAsItsOwnClassAndLeavesTheVerdictOpen) {
  const SignedDistance block(box_mesh(kLow, kHigh));
  InspectionOptions options;
  options.tolerance_mm = kToleranceMm;
  options.align = false;
  options.symmetry_tolerance_mm = 0;
  const InspectionResult residue = inspect(striped(0.4f, 0), block, options);
  ASSERT_FALSE(residue.defects.empty());
  for (const Defect& d : residue.defects) {
    EXPECT_EQ(d.kind, DefectClass::kRegistrationResidue) << d.words;
    EXPECT_NE(d.words.find("back"), std::string::npos) << d.words;
    EXPECT_FALSE(d.certain);
  }
  EXPECT_EQ(residue.verdict, Verdict::kUndecided) << residue.reason;

  const InspectionResult bump = inspect(striped(0, 0.5f), block, options);
  ASSERT_EQ(bump.defects.size(), 1u);
  EXPECT_NE(bump.defects[0].kind, DefectClass::kRegistrationResidue);
  EXPECT_EQ(bump.verdict, Verdict::kFail);
}

}  // namespace
}  // namespace gantry
