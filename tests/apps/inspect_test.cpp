// Options of `gantry-fusion inspect` that decide a verdict.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/geometry/surface_samples.h"
#include "geometry/solids.h"

namespace gantry::testing {
namespace {

class InspectCommand : public ::testing::Test {
 protected:
  InspectCommand() { write_mesh(folder_ / "box.stl", box_); }

  /// The box's surface, moved outwards by `offset_mm`, and 0.5 mm of dirt on its top if `dirty`.
  PointCloud measured(float offset_mm, bool dirty = false) {
    PointCloud cloud = sample_surface(box_, 6'000, 3);
    for (size_t i = 0; i < cloud.size(); ++i) {
      Eigen::Vector3f& p = cloud.points[i];
      const bool on_patch = cloud.normals[i].z() > 0.5f && (p - Eigen::Vector3f(15, 10, 10)).norm() < 4;
      p += (dirty && on_patch ? 0.5f : offset_mm) * cloud.normals[i];
      cloud.sigma_mm.push_back(0.01f);
    }
    return cloud;
  }
  int exit_code_of(const PointCloud& cloud, const std::vector<std::string>& more = {}) {
    write_point_cloud(folder_ / "cloud.ply", cloud, {{"sigma", cloud.sigma_mm}});
    std::vector<std::string> arguments = {"inspect",     "--cloud",           folder_ / "cloud.ply",
                                          "--reference", folder_ / "box.stl", "--tolerance",
                                          "0.2",         "--align",           "none",
                                          "--out",       folder_ / "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessResult result = run_program("gantry-fusion", arguments);
    out_ = result.out + result.err;
    return result.exit_code;
  }
  nlohmann::json report() { return nlohmann::json::parse(read_text(folder_ / "out/report.json")); }

  TemporaryFolder folder_;
  TriangleMesh box_ = box_mesh({0, 0, 0}, {30, 20, 10});
  std::string out_;
};

TEST_F(InspectCommand, VerdictFollowsTheGuardBandAndTheSensor) {
  const PointCloud near = measured(0.18f);  // u is a little more than 0.02 mm, the guard band 0.033 mm
  EXPECT_EQ(exit_code_of(near), 4) << out_;
  EXPECT_NE(out_.find("in doubt"), std::string::npos) << out_;
  EXPECT_TRUE(report()["defects"].empty());
  EXPECT_FALSE(report()["doubtful"].empty());
  EXPECT_EQ(report()["guard_band_sigmas"], 1.645);
  EXPECT_EQ(exit_code_of(near, {"--guard-band", "0"}), 0) << out_;
  EXPECT_EQ(exit_code_of(near, {"--sensor-sigma", "0.001"}), 0) << out_;
  EXPECT_LT(report()["uncertainty"]["typical_mm"], 0.02);
  EXPECT_TRUE(report()["uncertainty"]["scan_poses_sigma_mm"].is_null());
  EXPECT_EQ(exit_code_of(measured(0.22f)), 4) << out_;
  EXPECT_EQ(exit_code_of(measured(0.22f), {"--guard-band", "0"}), 1) << out_;
  EXPECT_EQ(exit_code_of(measured(0.3f)), 1) << out_;
  for (const char* option : {"--guard-band", "--sensor-sigma"})
    EXPECT_EQ(exit_code_of(near, {option, "-1"}), 2);
}

TEST_F(InspectCommand, WhatTheEmptyFixtureShowedIsNotJudged) {
  const PointCloud dirty = measured(0, true);
  EXPECT_EQ(exit_code_of(dirty), 1) << out_;
  PointCloud fixture;
  for (size_t i = 0; i < dirty.size(); ++i)
    if (dirty.points[i].z() > 10.4f) fixture.points.push_back(dirty.points[i]);
  write_point_cloud(folder_ / "fixture.ply", fixture);
  EXPECT_EQ(exit_code_of(dirty, {"--fixture-scan", folder_ / "fixture.ply"}), 0) << out_;
  EXPECT_EQ(report()["fixture_regions"].size(), 1u);
  EXPECT_GT(report()["unseen_mm2"], 30);
  EXPECT_NE(out_.find("fixture"), std::string::npos);
}

}  // namespace
}  // namespace gantry::testing
