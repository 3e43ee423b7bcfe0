#include "gantry/acquisition/cell.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numbers>

#include "acquisition/edited_file.h"

namespace gantry {
namespace {

const std::filesystem::path kCells = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/cells";
constexpr double kDeg = std::numbers::pi / 180;

TEST(Cell, TheShippedCellsLoad) {
  for (const char* file : {"simulated.yaml", "twin.yaml", "twin_rs485.yaml"}) {
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
    EXPECT_EQ(cell.calibrated_on, std::chrono::sys_days(std::chrono::year(2026) / 1 / 15));
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

TEST(Cell, MotionHomingAndSupervisorAreReadWithTheirDefaults) {
  std::string text = file_text(kCells / "simulated.yaml");
  const auto replace = [&text](const std::string& from, const std::string& to) {
    const size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
  };
  const Cell plain = read_cell(kCells / "simulated.yaml");
  EXPECT_EQ(plain.axes[0].limits.jogging_speed(), 24) << "a fifth of the speed";
  EXPECT_EQ(plain.axes[0].limits.unhomed_jogging_speed(), 2.4);
  EXPECT_EQ(plain.axes[0].limits.following_error, 2);
  EXPECT_EQ(plain.axes[0].limits.following_error_at_rest, 1);
  EXPECT_EQ(plain.axes[1].limits.following_error, 0) << "not watched";
  EXPECT_EQ(plain.drive_timeout_s, 0);

  replace("      speed_deg_s: 40\n",
          "      speed_deg_s: 40\n      jog_speed_deg_s: 3\n      unhomed_jog_speed_deg_s: 1\n"
          "      following_error_deg: 0.5\n      following_error_at_rest_deg: 0.1\n"
          "      following_error_time_s: 0.2\n      approach: from_above\n      approach_distance_deg: 2\n");
  replace("    - axis: linear\n    - axis: tilt\n    - axis: rotation\n",
          "    - { axis: linear, offset_mm: -3 }\n    - together: [ { axis: tilt, offset_deg: 1 }, { axis: "
          "rotation } ]\n");
  text +=
      "\nsupervisor: { period_ms: 5, stall_limit_s: 0.1, dead_man_s: 0.4, data_limit_s: 0.25, "
      "drive_timeout_s: 1 }\n";
  const TempFolder folder;
  std::ofstream(folder / "cell.yaml") << text;
  const Cell cell = read_cell(folder / "cell.yaml");
  EXPECT_EQ(cell.homing_order, (HomingOrder{{"linear"}, {"tilt", "rotation"}}));
  EXPECT_EQ(cell.axes[0].limits.position_at_home, -3);
  const AxisLimits& tilt = cell.axes[2].limits;
  EXPECT_NEAR(tilt.position_at_home, 1 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.jog_speed, 3 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.unhomed_jog_speed, 1 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.following_error, 0.5 * kDeg, 1e-12);
  EXPECT_NEAR(tilt.following_error_at_rest, 0.1 * kDeg, 1e-12);
  EXPECT_EQ(tilt.following_error_time_s, 0.2);
  EXPECT_EQ(cell.axes[2].approach, Approach::kFromAbove);
  EXPECT_NEAR(cell.axes[2].highest_target(), 73 * kDeg, 1e-12);
  EXPECT_NEAR(cell.axes[2].lowest_target(), -75 * kDeg, 1e-12);
  EXPECT_EQ(cell.supervisor.period_s, 0.005);
  EXPECT_EQ(cell.supervisor.stall_limit_s, 0.1);
  EXPECT_EQ(cell.supervisor.dead_man_s, 0.4);
  EXPECT_EQ(cell.drive_timeout_s, 1);
  for (const AxisSettings& axis : cell.axes) EXPECT_EQ(axis.limits.data_limit_s, 0.25);
}

TEST(Cell, AFileThatIsNotThereIsNamed) {
  try {
    read_cell("/nowhere/cell.yaml");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("/nowhere/cell.yaml"), std::string::npos);
  }
}

const std::string kBuses =
    "buses:\n"
    "  - { name: line, device: dev/line, baud: 38400, parity: none, stop_bits: 2, read_attempts: 3 }\n"
    "  - { name: gateway, host: 10.0.0.7, port: 503 }\n"
    "axes:\n";
const std::string kLinearDrive = "    drive: { profile: simulated }\n";

/// The shipped cell with `buses:` and another drive on its linear axis.
std::string with_buses(const std::string& drive, const std::string& buses = kBuses) {
  std::string text = file_text(kCells / "simulated.yaml");
  text.replace(text.find("axes:\n"), 6, buses);
  return text.replace(text.find(kLinearDrive), kLinearDrive.size(), "    drive: " + drive + "\n");
}

TEST(Cell, DrivesOnBuses) {
  const TempFolder folder;
  std::ofstream(folder / "cell.yaml")
      << with_buses("{ profile: leadshine_cs2rs, bus: line, unit: 4, steps_per_mm: 2000 }");
  const Cell cell = read_cell(folder / "cell.yaml");
  ASSERT_EQ(cell.buses.size(), 2u);
  const SerialLine& line = cell.buses[0].line;
  EXPECT_EQ(line.device, folder / "dev/line");
  EXPECT_EQ(line.baud, 38400);
  EXPECT_EQ(line.parity, Parity::kNone);
  EXPECT_EQ(line.stop_bits, 2);
  EXPECT_EQ(line.read_attempts, 3);
  EXPECT_FALSE(cell.buses[1].serial());
  EXPECT_EQ(cell.buses[1].port, 503);
  const DriveSettings& drive = cell.axes[0].drive;
  EXPECT_EQ(drive.bus, "line");
  EXPECT_EQ(drive.unit, 4);
  EXPECT_EQ(drive.counts_per_axis_unit, 2000);
  EXPECT_EQ(drive.counts_per_motor_revolution, 0);
}

TEST(Cell, AProfileFileIsFoundBesideTheCell) {
  const TempFolder folder;
  std::ofstream(folder / "mine.yaml") << "based_on: leadshine_cs2rs\nmodel: Mine\n";
  std::ofstream(folder / "cell.yaml") << with_buses(
      "{ profile: mine.yaml, bus: gateway, unit: 4, steps_per_mm: 2000, steps_per_motor_revolution: 4000 }");
  const DriveSettings drive = read_cell(folder / "cell.yaml").axes[0].drive;
  EXPECT_EQ(drive.profile, folder / "mine.yaml");
  EXPECT_EQ(drive.counts_per_motor_revolution, 4000);
}

class BusMistake : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(BusMistake, IsRefusedByKey) {
  const TempFolder folder;
  std::ofstream(folder / "cell.yaml")
      << with_buses("{ profile: simulated }", "buses:\n" + std::string(GetParam().first) + "axes:\n");
  try {
    read_cell(folder / "cell.yaml");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(GetParam().second), std::string::npos) << error.what();
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, BusMistake,
    testing::Values(std::pair("  - { name: a }\n", "buses[0]: missing key 'device'"),
                    std::pair("  - { name: a, device: x, baud: 1234 }\n", "buses[0].baud"),
                    std::pair("  - { name: a, device: x, parity: mark }\n", "buses[0].parity"),
                    std::pair("  - { name: a, device: x, stop_bits: 3 }\n", "buses[0].stop_bits"),
                    std::pair("  - { name: a, device: x, read_attempts: 0 }\n", "buses[0].read_attempts"),
                    std::pair("  - { name: a, device: x, late_answer_s: -1 }\n", "buses[0].late_answer_s"),
                    std::pair("  - { name: a, device: x, speed: 1 }\n", "buses[0].speed"),
                    std::pair("  - { name: a, host: h, device: x }\n", "buses[0].device"),
                    std::pair("  - { name: a, device: x }\n  - { name: a, device: y }\n", "buses[1].name"),
                    std::pair("  - { name: a, device: x }\n  - { name: b, device: x }\n",
                              "buses[1].device")));

class CellMistake : public testing::TestWithParam<Mistake> {};

TEST_P(CellMistake, IsRefusedWithFileLineAndKey) {
  expect_named(GetParam(), kCells / "simulated.yaml", [](const auto& path) { read_cell(path); });
}

const std::string kDrive = "    drive: { profile: simulated }\n";
const std::string kTiltDrive = kDrive + "\n# Safe order";

INSTANTIATE_TEST_SUITE_P(
    Axes, CellMistake,
    testing::Values(
        Mistake{"NoAxes", "axes:\n", "axles:\n", -5, "missing key 'axes'"},
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
        Mistake{"StepsOfTheWrongJoint", kDrive,
                "    drive: { profile: oriental_motor_az, host: a, unit: 1, steps_per_revolution: 36000 }\n",
                0, "axes[0].drive: missing key 'steps_per_mm'"},
        Mistake{"StepsThatTheDriveFixes", kDrive,
                "    drive: { profile: iai_robo_cylinder, host: a, unit: 1, steps_per_mm: 100 }\n", 0,
                "axes[0].drive.steps_per_mm"},
        Mistake{"NoSuchBus", kDrive,
                "    drive: { profile: kinco_fd, bus: line, unit: 1, steps_per_mm: 1 }\n", 0,
                "axes[0].drive.bus: there is no bus 'line'"},
        Mistake{"NoSuchProfileFile", kDrive, "    drive: { profile: mine.yaml, host: a, unit: 1 }\n", 0,
                "axes[0].drive.profile"},
        Mistake{"TwoDrivesOfOneUnit", kDrive + "  - name: rotation",
                "    drive: { profile: iai_robo_cylinder, host: a, unit: 1 }\n"
                "  - { name: more, joint: { kind: prismatic, direction: [0, 1, 0], repeatability_mm: 0.005,\n"
                "      direction_sigma_deg: 0.03 }, motion: { soft_limits_mm: [5, 295], speed_mm_s: 120,\n"
                "      acceleration_mm_s2: 600, in_position_mm: 0.03 },\n"
                "      drive: { profile: kinco_fd, host: a, unit: 1, steps_per_mm: 100 } }\n"
                "  - name: rotation",
                4, "axes[1].drive: another axis has unit 1 at a:502"},
        Mistake{"IaiOnARevoluteJoint", kTiltDrive,
                "    drive: { profile: iai_robo_cylinder, host: a, unit: 1 }\n#", 0,
                "axes[2].drive.profile: a drive IAI ROBO Cylinder moves no revolute joint"},
        Mistake{"NoHost", kDrive, "    drive: { profile: iai_robo_cylinder, unit: 1 }\n", 0,
                "missing key 'host'"},
        Mistake{"UnitOutOfRange", kDrive, "    drive: { profile: iai_robo_cylinder, host: a, unit: 248 }\n",
                0, "axes[0].drive.unit"},
        Mistake{"AddressOfASimulatedDrive", kDrive, "    drive: { profile: simulated, host: a }\n", 0,
                "axes[0].drive.host"}),
    mistake_name);

const std::string kBand = "      in_position_mm: 0.03\n";

INSTANTIATE_TEST_SUITE_P(
    Motion, CellMistake,
    testing::Values(Mistake{"JogFasterThanTheAxis", kBand, kBand + "      jog_speed_mm_s: 121\n", 1,
                            "axes[0].motion.jog_speed_mm_s"},
                    Mistake{"MoreFollowingErrorAtRest", "following_error_mm: 2 ",
                            "following_error_mm: 2\n      following_error_at_rest_mm: 3 ", 1,
                            "axes[0].motion.following_error_at_rest_mm"},
                    Mistake{"UnknownApproach", kBand, kBand + "      approach: sideways\n", 1,
                            "axes[0].motion.approach"},
                    Mistake{"ApproachWithoutDistance", kBand, kBand + "      approach: from_below\n", -3,
                            "missing key 'approach_distance_mm'"},
                    Mistake{"ApproachLongerThanTheTravel", kBand,
                            kBand + "      approach: from_below\n      approach_distance_mm: 300\n", 2,
                            "axes[0].motion.approach_distance_mm: leaves no target"},
                    Mistake{"DistanceWithoutApproach", kBand, kBand + "      approach_distance_mm: 1\n", 1,
                            "axes[0].motion.approach_distance_mm"},
                    Mistake{"TogetherAlone", "    - axis: tilt\n", "    - together: [ { axis: tilt } ]\n", 0,
                            "homing.order[1].together"},
                    Mistake{"OffsetInTheWrongUnit", "    - axis: tilt\n",
                            "    - { axis: tilt, offset_mm: 1 }\n", 0, "homing.order[1].offset_mm"},
                    Mistake{"ImpatientSupervisor", "name: demo cell",
                            "supervisor: { stall_limit_s: 0.01 }\nname: demo cell", 0,
                            "supervisor.stall_limit_s: must be longer than two periods"},
                    Mistake{"UnknownSupervisorKey", "name: demo cell",
                            "supervisor: { speed: 1 }\nname: demo cell", 0, "supervisor.speed"}),
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
                    Mistake{"NoDate", "calibrated_on: 2026-01-15", "calibrated_on: 15.1.2026", 0,
                            "calibrated_on: '15.1.2026' is no date"},
                    Mistake{"NoDayOfItsMonth", "calibrated_on: 2026-01-15", "calibrated_on: 2026-02-30", 0,
                            "calibrated_on: '2026-02-30' is no date"},
                    Mistake{"NegativeSigma", "position_sigma_mm: 0.08", "position_sigma_mm: -1", 0,
                            "sensor.position_sigma_mm"},
                    Mistake{"KeyTwice", "name: demo cell", "name: a\nname: b", 1, "name"}),
    mistake_name);

}  // namespace
}  // namespace gantry
