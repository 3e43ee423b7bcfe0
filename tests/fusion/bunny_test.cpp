#include <gtest/gtest.h>

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
/// Overlap residual that the best of other programs reach on these six scans.
constexpr double kBestKnown_mm = 0.1117;

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
    scan.part_from_sensor.independent = covariance_about(centre_of(scan), 1, 1 * kDegree);
    scans.push_back(std::move(scan));
  }
  return scans;
}

FusionResult fuse(const std::vector<TaggedScan>& scans) {
  FusionOptions options;
  options.merge_scans = false;
  Fusion fusion(options);
  for (const TaggedScan& scan : scans) fusion.add(scan);
  return fusion.finish();
}

/// The scans with all tags but the first moved about each scan's middle, and the covariance to match.
std::vector<TaggedScan> perturbed(std::vector<TaggedScan> scans, double shift_mm, double rotation_rad) {
  std::mt19937 random(41);
  for (size_t i = 0; i < scans.size(); ++i) {
    const Eigen::Vector3d centre = centre_of(scans[i]);
    UncertainPose& tag = scans[i].part_from_sensor;
    tag.independent = covariance_about(centre, shift_mm, rotation_rad);
    if (i > 0) tag.mean = random_motion(random, centre, shift_mm, rotation_rad) * tag.mean;
  }
  return scans;
}

TEST(Bunny, RealScansEndUpWhereTheyDidUnperturbed) {
  if (!std::filesystem::exists(bunny_folder() / "bun.conf"))
    GTEST_SKIP() << "the range scans of the Stanford bunny are not in " << bunny_folder();
  const std::vector<TaggedScan> scans = bunny_scans();
  ASSERT_EQ(scans.size(), 6u);
  const FusionResult reference = fuse(scans);
  EXPECT_TRUE(reference.trusted) << reference.reason;
  EXPECT_LE(reference.after.rms_mm, kBestKnown_mm);

  for (const double size : {2.0, 8.0}) {
    const FusionResult result = fuse(perturbed(scans, size, size * kDegree));
    EXPECT_GT(result.before.rms_mm, 2 * reference.after.rms_mm);
    EXPECT_TRUE(result.trusted) << result.reason;
    EXPECT_LE(result.after.rms_mm, kBestKnown_mm) << "from " << size << " mm and deg";
    EXPECT_GT(result.after.matches, 0.95 * static_cast<double>(reference.after.matches));
    for (size_t i = 0; i < scans.size(); ++i) {
      const Eigen::Vector3d centre = centre_of(scans[i]);
      const Pose moved =
          result.scans[i].part_from_sensor.mean * reference.scans[i].part_from_sensor.mean.inverse();
      EXPECT_LT((moved * centre - centre).norm(), 0.05) << scans[i].name;
    }
  }
}

}  // namespace
}  // namespace gantry
