#include "gantry/acquisition/cell.h"

#include <gtest/gtest.h>

#include <numbers>

#include "acquisition/edited_file.h"

namespace gantry {
namespace {

const std::filesystem::path kCells = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/cells";
constexpr double kDeg = std::numbers::pi / 180;

TEST(Cell, TheShippedCellsLoad) {
  for (const char* file : {"simulated.yaml", "twin.yaml"}) {
    const Cell cell = read_cell(kCells / file);
    ASSERT_EQ(cell.axes.size(), 3u) << file;
    ASSERT_EQ(cell.chain.joints.size(), 3u);
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(cell.axes[i].name, cell.chain.joints[i].name);
      EXPECT_EQ(cell.axes[i].kind == AxisKind::kLinear, cell.chain.joints[i].kind == JointKind::kPrismatic);
      EXPECT_LT(cell.axes[i].limits.lower, cell.axes[i].limits.upper);
    }
    EXPECT_EQ(cell.homing_order.size(), 3u);
    EXPECT_FALSE(cell.calibration_id.empty());
    EXPECT_TRUE(std::filesystem::exists(cell.fixture)) << cell.fixture;
  }
  EXPECT_EQ(read_cell(kCells / "twin.yaml").scanner.kind, "genicam3d");
}

TEST(Cell, DegreesInTheFileAreRadiansInTheProgram) {
  const Cell cell = read_cell(kCells / "simulated.yaml");
  EXPECT_EQ(cell.scanner.kind, "simulated");
  EXPECT_EQ(cell.axes[0].limits.lower, 5);
  EXPECT_EQ(cell.axes[0].limits.speed, 120);
  const AxisLimits& tilt = cell.axes[2].limits;
  EXPECT_NEAR(tilt.lower, -75 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.upper, 75 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.speed, 40 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.acceleration, 160 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.in_position, 0.02 * kDeg, 1e-12);
  EXPECT_NEAR(cell.chain.joints[2].repeatability, 0.002 * kDeg, 1e-12);
  EXPECT_EQ(cell.homing_order, (HomingOrder{{"linear"}, {"tilt"}, {"rotation"}}));
  // The sensor looks down by 35 degrees, away from the base's origin side: along +y.
  const Eigen::Vector3d view = cell.chain.base_from_sensor.linear().col(2);
  EXPECT_NEAR(view.y(), std::cos(35 * kDeg), 1e-6);
  EXPECT_NEAR(view.z(), -std::sin(35 * kDeg), 1e-6);
}

TEST(Cell, AFileThatIsNotThereIsNamed) {
  try {
    read_cell("/nowhere/cell.yaml");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("/nowhere/cell.yaml"), std::string::npos);
  }
}

class CellMistake : public testing::TestWithParam<Mistake> {};

TEST_P(CellMistake, IsRefusedWithFileLineAndKey) {
  expect_named(GetParam(), kCells / "simulated.yaml", [](const auto& path) { read_cell(path); });
}

const std::string kDrive = "    drive: { profile: simulated }\n";
const std::string kTiltDrive = kDrive + "\n# Safe order";

INSTANTIATE_TEST_SUITE_P(
    Axes, CellMistake,
    testing::Values(
        Mistake{"NoAxes", "axes:\n", "axles:\n", -4, "missing key 'axes'"},
        Mistake{"TwoOfOneName", "- name: rotation", "- name: linear", 0,
                "axes[1].name: two axes are called 'linear'"},
        Mistake{"InvertedLimits", "soft_limits_mm: [5, 295]", "soft_limits_mm: [295, 5]", 0,
                "axes[0].motion.soft_limits_mm"},
        Mistake{"InvertedAngles", "soft_limits_deg: [-75, 75]", "soft_limits_deg: [75, -75]", 0,
                "axes[2].motion.soft_limits_deg"},
        Mistake{"NegativeSpeed", "speed_mm_s: 120", "speed_mm_s: -120", 0, "axes[0].motion.speed_mm_s"},
        Mistake{"ZeroBand", "in_position_mm: 0.03", "in_position_mm: 0", 0, "axes[0].motion.in_position_mm"},
        Mistake{"WrongUnit", "speed_mm_s: 120", "speed_deg_s: 120", -1, "missing key 'speed_mm_s'"},
        Mistake{"UnknownKey", "speed_mm_s: 120", "speed_mm_s: 120\n      sped: 1", 1, "axes[0].motion.sped"},
        Mistake{"NoDirection", "direction: [0, 1, 0]", "direction: [0, 0, 0]", 0, "axes[0].joint.direction"},
        Mistake{"UnknownJoint", "kind: prismatic", "kind: helical", 0, "axes[0].joint.kind"}),
    mistake_name);

INSTANTIATE_TEST_SUITE_P(
    Drives, CellMistake,
    testing::Values(
        Mistake{"UnknownProfile", kDrive, "    drive: { profile: magic }\n", 0, "axes[0].drive.profile"},
        Mistake{"OrientalOnALinearJoint", kDrive,
                "    drive: { profile: oriental_motor_az, host: a, unit: 1, steps_per_revolution: 36000 }\n",
                0, "axes[0].drive: oriental_motor_az drives revolute joints"},
        Mistake{"IaiOnARevoluteJoint", kTiltDrive,
                "    drive: { profile: iai_robo_cylinder, host: a, unit: 1 }\n#", 0,
                "axes[2].drive: iai_robo_cylinder is a linear drive"},
        Mistake{"NoHost", kDrive, "    drive: { profile: iai_robo_cylinder, unit: 1 }\n", 0,
                "missing key 'host'"},
        Mistake{"UnitOutOfRange", kDrive, "    drive: { profile: iai_robo_cylinder, host: a, unit: 248 }\n",
                0, "axes[0].drive.unit"},
        Mistake{"AddressOfASimulatedDrive", kDrive, "    drive: { profile: simulated, host: a }\n", 0,
                "axes[0].drive.host"}),
    mistake_name);

INSTANTIATE_TEST_SUITE_P(
    Rest, CellMistake,
    testing::Values(Mistake{"HomingForgetsAnAxis", "  order:\n    - axis: linear\n    - axis: tilt\n",
                            "  order:\n    - axis: linear\n", 0, "homing.order: every axis must be homed"},
                    Mistake{"HomingOfAnUnknownAxis", "- axis: tilt", "- axis: tlit", 0,
                            "homing.order[1].axis: there is no axis 'tlit'"},
                    Mistake{"HomingTwice", "- axis: tilt", "- axis: linear", 0,
                            "homing.order[1].axis: axis 'linear' is homed twice"},
                    Mistake{"UnknownScanner", "scanner: { kind: simulated }", "scanner: { kind: lidar }", 0,
                            "sensor.scanner.kind"},
                    Mistake{"ScannerWithoutAddress", "scanner: { kind: simulated }",
                            "scanner: { kind: genicam3d }", 0, "missing key 'address'"},
                    Mistake{"UnknownKey", "name: demo cell", "colour: red\nname: demo cell", 0, "colour"},
                    Mistake{"NoCalibration", "calibration_id: nominal-2026-01", "#", -1,
                            "missing key 'calibration_id'"},
                    Mistake{"NegativeSigma", "position_sigma_mm: 0.08", "position_sigma_mm: -1", 0,
                            "sensor.position_sigma_mm"},
                    Mistake{"KeyTwice", "name: demo cell", "name: a\nname: b", 1, "name"}),
    mistake_name);

}  // namespace
}  // namespace gantry
