// gantry-fusion compare: what it prints and writes, its exit codes, and what it refuses.

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "foundation/temporary_folder.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/geometry/surface_samples.h"
#include "geometry/solids.h"

namespace gantry::testing {
namespace {

constexpr float kShift_mm = 0.25f;

/// A box of 10 mm as STL and as PLY, points on its top and the same points moved up.
class Compare : public ::testing::Test {
 protected:
  Compare() {
    const TriangleMesh box = box_mesh({0, 0, 0}, {10, 10, 10});
    write_mesh(stl(), box);
    write_mesh(folder_ / "box.ply", box);
    PointCloud top;
    for (int i = 1; i < 40; ++i)
      for (int j = 1; j < 40; ++j)
        top.points.emplace_back(0.25f * static_cast<float>(i), 0.25f * static_cast<float>(j), 10);
    write_point_cloud(low(), top);
    for (auto& p : top.points) p.z() += kShift_mm;
    write_point_cloud(high(), top);
  }
  std::string stl() const { return folder_ / "box.stl"; }
  std::string low() const { return folder_ / "low.ply"; }
  std::string high() const { return folder_ / "high.ply"; }

  static ProcessResult run(const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"compare", "--log-level", "warn"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return run_program("gantry-fusion", all);
  }
  nlohmann::json json_of(std::vector<std::string> arguments) const {
    arguments.insert(arguments.end(), {"--json", folder_ / "out.json"});
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return nlohmann::json::parse(TemporaryFolder::read(folder_ / "out.json"));
  }
  static void refused(const std::vector<std::string>& arguments, const std::vector<std::string>& says) {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_code, 2);
    for (const std::string& word : says)
      EXPECT_NE((result.err + result.out).find(word), std::string::npos)
          << "'" << word << "' not in: " << result.err;
  }

  TemporaryFolder folder_;
};

TEST_F(Compare, TwoCloudsByAllMetricsThatThereAre) {
  const nlohmann::json json = json_of({high(), low()});
  EXPECT_EQ(json["reference"]["kind"], "cloud");
  EXPECT_EQ(json["compared"]["points"], 39 * 39);
  ASSERT_EQ(json["metrics"].size(), 9u);  // all but cloud-to-mesh
  for (const auto& metric : json["metrics"]) {
    const double expected = metric["unit"] == "mm2" ? 2 * kShift_mm * kShift_mm : kShift_mm;
    EXPECT_NEAR(metric["value"], expected, 1e-5) << metric["name"];
    EXPECT_NEAR(metric["distances_mm"]["mean"], kShift_mm, 1e-5) << metric["name"];
    EXPECT_FALSE(metric["meaning"].get<std::string>().empty());
  }
}

TEST_F(Compare, ACloudWithAMeshAndItsPly) {
  for (const std::string& mesh : {stl(), std::string(folder_ / "box.ply")}) {
    const nlohmann::json json = json_of({high(), mesh, "--samples", "50000", "--ply", folder_ / "out.ply"});
    EXPECT_EQ(json["reference"]["kind"], "mesh");
    EXPECT_EQ(json["reference"]["points"], 50000);
    ASSERT_EQ(json["metrics"].size(), 10u);
    EXPECT_EQ(json["metrics"][0]["name"], "cloud-to-mesh");
    EXPECT_NEAR(json["metrics"][0]["distances_mm"]["min"], kShift_mm, 1e-5);  // with its sign
  }
  const std::string ply = TemporaryFolder::read(folder_ / "out.ply");
  const std::string header = ply.substr(0, ply.find("end_header"));
  for (const std::string field : {"distance", "distance_chamfer", "distance_m3c2", "lod95"})
    EXPECT_NE(header.find("property float " + field + "\n"), std::string::npos) << header;
  EXPECT_EQ(read_point_cloud(folder_ / "out.ply").points, read_point_cloud(high()).points);
}

TEST_F(Compare, ThePlyHoldsTheDistanceOfEachPoint) {
  const ProcessResult result = run({"--metric", "cloud-to-mesh", low(), stl(), "--ply", folder_ / "out.ply"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("cloud-to-mesh"), std::string::npos);
  EXPECT_EQ(result.out.find("chamfer"), std::string::npos);
  const std::string ply = TemporaryFolder::read(folder_ / "out.ply");
  const size_t body = ply.find("end_header\n") + 11, row = 4 * sizeof(float);
  ASSERT_EQ(ply.size() - body, 39 * 39 * row);
  for (size_t i = 0; i < 39 * 39; ++i) {
    float distance = 1;
    std::memcpy(&distance, ply.data() + body + i * row + 3 * sizeof(float), sizeof distance);
    EXPECT_NEAR(distance, 0, 1e-5);
  }
}

TEST_F(Compare, UnitsAndOptionsReachTheMetrics) {
  // The cloud in metres, as it were: 0.25 of them are 250 mm.
  PointCloud small = read_point_cloud(high());
  for (auto& p : small.points) p /= 1000;
  write_point_cloud(folder_ / "metres.ply", small);
  const nlohmann::json json =
      json_of({folder_ / "metres.ply", low(), "--unit", "m", "--metric", "plane,percentile-hausdorff,m3c2",
               "--k", "9", "--percentile", "50", "--registration-mm", "0.5", "--depth-mm", "1"});
  ASSERT_EQ(json["metrics"].size(), 3u);
  for (const auto& metric : json["metrics"]) EXPECT_NEAR(metric["value"], kShift_mm, 1e-4) << metric["name"];
  EXPECT_EQ(json["options"]["k"], 9);
  EXPECT_NE(json["metrics"][0]["meaning"].get<std::string>().find("9 points"), std::string::npos);
  EXPECT_NE(json["metrics"][1]["meaning"].get<std::string>().find("50 %"), std::string::npos);
  EXPECT_NEAR(json["metrics"][2]["lod95"]["mean_mm"], 1.96 * 0.5, 1e-3);
  EXPECT_EQ(json["metrics"][2]["lod95"]["exceeded"], 0);
  const nlohmann::json other =
      json_of({high(), folder_ / "metres.ply", "--reference-unit", "m", "--metric", "hausdorff"});
  EXPECT_NEAR(other["metrics"][0]["value"], 0, 1e-4);
}

TEST_F(Compare, RefusesWhatDoesNotFit) {
  refused({high()}, {"B"});
  refused({high(), low(), "--metric", "manhattan"}, {"--metric", "manhattan"});
  refused({high(), low(), "--metric", "cloud-to-mesh"}, {"cloud-to-mesh", "mesh"});
  refused({high(), low(), "--k", "2"}, {"--k"});
  refused({high(), low(), "--percentile", "nan"}, {"--percentile"});
  refused({high(), low(), "--percentile", "0"}, {"--percentile"});
  refused({high(), low(), "--registration-mm", "-1"}, {"--registration-mm"});
  refused({high(), folder_ / "missing.ply"}, {"missing.ply"});
  refused({folder_ / "missing.ply", low()}, {"missing.ply"});
  refused({stl(), low()}, {"box.stl"});
  refused({high(), low(), "--json", folder_ / "no/such/out.json"}, {"--json", "no/such"});
  refused({high(), low(), "--ply", folder_.path().string()}, {"--ply", "folder"});
  PointCloud few;
  few.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  write_point_cloud(folder_ / "few.ply", few);
  refused({high(), folder_ / "few.ply", "--metric", "plane"}, {"plane", "6 neighbours", "only 3 points"});
  refused({high(), folder_ / "few.ply", "--metric", "m3c2"}, {"m3c2", "four points"});
}

}  // namespace
}  // namespace gantry::testing
