#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>

#include "fusion/scenes.h"
#include "gantry/fusion/fusion.h"
#include "gantry/geometry/scan_file.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kPerturbationMm = 2, kPerturbationRad = 2 * kDegree;

std::filesystem::path bunny_folder() {
  return std::filesystem::path(GANTRY_SOURCE_DIR) / "../shared/data/bunny";
}

/// In the part frame.
Eigen::Vector3d centre_of(const TaggedScan& scan) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    if (scan.scan.valid(i)) sum += scan.scan.points[i].cast<double>();
  return scan.part_from_sensor.mean * (sum / static_cast<double>(scan.scan.valid_count()));
}

/// The range scans of the Stanford bunny with the poses that came with them. bun.conf lists translation
/// (m) and quaternion (x y z w) in vrip's convention, which turns the other way.
std::vector<TaggedScan> bunny_scans() {
  std::vector<TaggedScan> scans;
  std::ifstream conf(bunny_folder() / "bun.conf");
  for (std::string line; std::getline(conf, line);) {
    std::istringstream words(line);
    std::string kind, file;
    double tx, ty, tz, qx, qy, qz, qw;
    if (!(words >> kind >> file >> tx >> ty >> tz >> qx >> qy >> qz >> qw) || kind != "bmesh") continue;
    if (!std::filesystem::exists(bunny_folder() / file)) continue;
    TaggedScan scan;
    scan.name = file;
    scan.scan = read_scan(bunny_folder() / file, 1000).scan;
    scan.part_from_sensor.mean.linear() = Eigen::Quaterniond(-qw, qx, qy, qz).normalized().toRotationMatrix();
    scan.part_from_sensor.mean.translation() = 1000 * Eigen::Vector3d(tx, ty, tz);
    scan.part_from_sensor.independent = covariance_about(centre_of(scan), kPerturbationMm, kPerturbationRad);
    scans.push_back(std::move(scan));
  }
  return scans;
}

FusionResult fuse(const std::vector<TaggedScan>& scans) {
  Fusion fusion({});
  for (const TaggedScan& scan : scans) fusion.add(scan);
  return fusion.finish();
}

TEST(Bunny, RealScansEndUpWhereTheyDidUnperturbed) {
  if (!std::filesystem::exists(bunny_folder() / "bun.conf"))
    GTEST_SKIP() << "the range scans of the Stanford bunny are not in " << bunny_folder();
  std::vector<TaggedScan> scans = bunny_scans();
  ASSERT_EQ(scans.size(), 6u);
  const FusionResult reference = fuse(scans);

  std::mt19937 random(41);
  for (size_t i = 1; i < scans.size(); ++i)
    scans[i].part_from_sensor.mean =
        random_motion(random, centre_of(scans[i]), kPerturbationMm, kPerturbationRad) *
        scans[i].part_from_sensor.mean;
  const auto begin = std::chrono::steady_clock::now();
  const FusionResult result = fuse(scans);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();

  EXPECT_TRUE(result.trusted) << result.reason;
  EXPECT_GT(result.before.rms_mm, 2 * reference.after.rms_mm);
  EXPECT_NEAR(result.after.rms_mm, reference.after.rms_mm, 0.05 * reference.after.rms_mm);
  EXPECT_GE(std::count_if(result.edges.begin(), result.edges.end(), [](const auto& e) { return e.kept; }), 9);
  EXPECT_LT(seconds, 10);
  RecordProperty("after_um", static_cast<int>(1000 * result.after.rms_mm));
}

}  // namespace
}  // namespace gantry
