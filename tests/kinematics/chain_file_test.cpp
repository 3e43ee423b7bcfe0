#include "gantry/kinematics/chain_file.h"

#include <gtest/gtest.h>

#include <numbers>

#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

const std::string kRevolute =
    "kind: revolute\n"
    "direction: [0, 0, 2]\n"
    "point_mm: [1, 2, 100]\n"
    "repeatability_deg: 0.002\n"
    "direction_sigma_deg: 0.02\n"
    "point_sigma_mm: 0.05\n";
const std::string kPrismatic =
    "kind: prismatic\n"
    "direction: [3, 4, 0]\n"
    "repeatability_mm: 0.01\n"
    "direction_sigma_deg: 0.02\n";

/// `text` with the line of `key` replaced ("" takes it away).
std::string with(const std::string& text, const std::string& key, const std::string& line) {
  const size_t begin = text.find(key + ":"), end = text.find('\n', begin) + 1;
  return text.substr(0, begin) + (line.empty() ? "" : line + "\n") + text.substr(end);
}

Joint read(const std::string& text) {
  return read_joint(StrictYaml::parse(text, "cell.yaml"), "tilt");
}

void expect_refused(const std::string& text, const std::vector<std::string>& parts) {
  SCOPED_TRACE(text);
  expect_input_error([&] { read(text); }, parts);
}

TEST(ChainFile, ReadsARevoluteJoint) {
  const Joint j = read(kRevolute);
  EXPECT_EQ(j.name, "tilt");
  EXPECT_EQ(j.kind, JointKind::kRevolute);
  EXPECT_EQ(j.direction, Eigen::Vector3d::UnitZ()) << "any length is made a unit vector";
  EXPECT_EQ(j.point_mm, Eigen::Vector3d(1, 2, 100));
  EXPECT_NEAR(j.repeatability, 0.002 * kDeg, 1e-15);
  EXPECT_NEAR(j.direction_sigma_rad, 0.02 * kDeg, 1e-15);
  EXPECT_EQ(j.point_sigma_mm, 0.05);
}

TEST(ChainFile, ReadsAPrismaticJoint) {
  const Joint j = read(kPrismatic);
  EXPECT_EQ(j.kind, JointKind::kPrismatic);
  EXPECT_TRUE(j.direction.isApprox(Eigen::Vector3d(0.6, 0.8, 0)));
  EXPECT_EQ(j.repeatability, 0.01);
  EXPECT_NEAR(j.direction_sigma_rad, 0.02 * kDeg, 1e-15);
}

TEST(ChainFile, EveryKeyIsNeeded) {
  for (const char* key :
       {"kind", "direction", "point_mm", "repeatability_deg", "direction_sigma_deg", "point_sigma_mm"})
    expect_refused(with(kRevolute, key, ""), {"cell.yaml:1:", "missing", key});
  for (const char* key : {"kind", "direction", "repeatability_mm", "direction_sigma_deg"})
    expect_refused(with(kPrismatic, key, ""), {"cell.yaml:1:", "missing", key});
}

TEST(ChainFile, KeysOfTheOtherKindAreUnknown) {
  expect_refused(kPrismatic + "point_mm: [0, 0, 0]\n", {"cell.yaml:5:", "point_mm", "unknown"});
  expect_refused(kPrismatic + "repeatability_deg: 1\n", {"cell.yaml:5:", "repeatability_deg", "unknown"});
  expect_refused(kRevolute + "repeatability_mm: 1\n", {"cell.yaml:7:", "repeatability_mm", "unknown"});
}

TEST(ChainFile, WrongValuesAreRefusedWithTheirLine) {
  expect_refused(with(kRevolute, "kind", "kind: sideways"),
                 {"cell.yaml:1:", "kind", "prismatic, revolute", "sideways"});
  expect_refused(with(kRevolute, "direction", "direction: [0, 0, 0]"), {"cell.yaml:2:", "direction", "zero"});
  expect_refused(with(kRevolute, "direction", "direction: [0, .nan, 1]"),
                 {"cell.yaml:2:", "direction", "number"});
  expect_refused(with(kRevolute, "direction", "direction: [0, 1]"), {"cell.yaml:2:", "direction", "three"});
  expect_refused(with(kRevolute, "point_mm", "point_mm: here"), {"cell.yaml:3:", "point_mm", "list"});
  expect_refused(with(kRevolute, "repeatability_deg", "repeatability_deg: -0.1"),
                 {"cell.yaml:4:", "repeatability_deg"});
  expect_refused(with(kRevolute, "direction_sigma_deg", "direction_sigma_deg: 11"),
                 {"cell.yaml:5:", "direction_sigma_deg", "10"});
  expect_refused(with(kRevolute, "point_sigma_mm", "point_sigma_mm: -1"), {"cell.yaml:6:", "point_sigma_mm"});
  expect_refused(kRevolute + "kind: revolute\n", {"cell.yaml:", "kind", "twice"});
}

TEST(ChainFile, ReadsAPoseAndLeavesOtherKeysAlone) {
  StrictYaml yaml =
      StrictYaml::parse("position_mm: [1, 2, 3]\nrotation_rpy_deg: [90, 0, 90]\nmore: 1\n", "cell.yaml");
  const Pose pose = read_pose(yaml);
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(1, 2, 3));
  // Roll takes z to -y, then yaw takes -y to x.
  EXPECT_TRUE((pose.linear() * Eigen::Vector3d::UnitZ()).isApprox(Eigen::Vector3d::UnitX(), 1e-12));
  expect_input_error([&] { yaml.finish(); }, {"cell.yaml:3:", "more"});
}

TEST(ChainFile, APoseNeedsBothKeys) {
  for (const char* text : {"position_mm: [1, 2, 3]\n", "rotation_rpy_deg: [0, 0, 0]\n"}) {
    StrictYaml yaml = StrictYaml::parse(text, "cell.yaml");
    expect_input_error([&] { read_pose(yaml); }, {"cell.yaml:1:", "missing"});
  }
}

}  // namespace
}  // namespace gantry
