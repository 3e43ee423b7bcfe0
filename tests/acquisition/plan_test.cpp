#include "gantry/acquisition/plan.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <numbers>

#include "acquisition/edited_file.h"

namespace gantry {
namespace {

const std::filesystem::path kExamples = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples";
const std::filesystem::path kPlan = kExamples / "plans/bracket.yaml";
constexpr double kDeg = std::numbers::pi / 180;

const Cell& cell() {
  static const Cell cell = read_cell(kExamples / "cells/simulated.yaml");
  return cell;
}

TEST(Plan, TheShippedPlanLoadsForBothCells) {
  for (const char* name : {"simulated.yaml", "twin.yaml"}) {
    const Plan plan = read_plan(kPlan, read_cell(kExamples / "cells" / name));
    ASSERT_EQ(plan.viewpoints.size(), 11u);
    EXPECT_EQ(plan.name, "bracket");
    EXPECT_EQ(plan.tolerance_mm, 0.2);
    EXPECT_EQ(plan.crop_margin_mm, 10);
    const Viewpoint& view = plan.viewpoints[2];
    EXPECT_EQ(view.name, "below-front-right");
    EXPECT_EQ(view.q.at(0), 100);
    EXPECT_NEAR(view.q.at(1), 40 * kDeg, 1e-12);
    EXPECT_NEAR(view.q.at(2), -66 * kDeg, 1e-12);
    EXPECT_EQ(view.exposure_s, 0.1);
    EXPECT_EQ(view.dwell_s, 0);
  }
}

Plan plan_of(const std::string& viewpoints) {
  const TempFolder folder;
  std::ofstream(folder / "plan.yaml")
      << "name: x\nexposure_ms: 100\ndwell_s: 1\ninspection: { tolerance_mm: 0.1 }\n"
      << "viewpoints:\n"
      << viewpoints;
  return read_plan(folder / "plan.yaml", cell());
}

TEST(Plan, AViewpointsOwnExposureAndDwellComeBeforeThePlans) {
  const Plan plan = plan_of(
      "  - { name: a, joints: { linear_mm: 5, rotation_deg: -185, tilt_deg: 75 } }\n"
      "  - { name: b, joints: { linear_mm: 295, rotation_deg: 0, tilt_deg: 0 }, exposure_ms: 250, dwell_s: 2 "
      "}\n");
  EXPECT_EQ(plan.viewpoints[0].exposure_s, 0.1);
  EXPECT_EQ(plan.viewpoints[0].dwell_s, 1);
  EXPECT_EQ(plan.viewpoints[1].exposure_s, 0.25);
  EXPECT_EQ(plan.viewpoints[1].dwell_s, 2);
}

TEST(Plan, ASensorPoseComputedFromJointsGivesTheSameView) {
  for (const std::vector<double>& q : {std::vector<double>{100, 0, 54 * kDeg},
                                       {100, 45 * kDeg, 0},
                                       {80, -140 * kDeg, 66 * kDeg},
                                       {140, 90 * kDeg, -30 * kDeg}}) {
    const Pose wanted = cell().chain.part_from_sensor(q);
    const Eigen::Vector3d from = wanted.translation(), at = wanted * Eigen::Vector3d(0, 0, 480);
    char text[300];
    std::snprintf(
        text, sizeof text,
        "  - { name: v, sensor: { position_mm: [%.9f, %.9f, %.9f], look_at_mm: [%.9f, %.9f, %.9f] } }\n",
        from.x(), from.y(), from.z(), at.x(), at.y(), at.z());
    const Pose found = cell().chain.part_from_sensor(plan_of(text).viewpoints.at(0).q);
    EXPECT_LT(translation_distance(found, wanted), 0.01) << text;
    EXPECT_GT(found.linear().col(2).dot(wanted.linear().col(2)), std::cos(1e-4)) << text;
  }
}

class PlanMistake : public testing::TestWithParam<Mistake> {};

TEST_P(PlanMistake, IsRefusedWithFileLineAndViewpoint) {
  expect_named(GetParam(), kPlan, [](const auto& path) { read_plan(path, cell()); });
}

const std::string kTop = "{ name: top, joints: { linear_mm: 100, rotation_deg: 0, tilt_deg: 54 } }";

INSTANTIATE_TEST_SUITE_P(
    Viewpoints, PlanMistake,
    testing::Values(
        Mistake{"AboveASoftLimit", "name: right, joints: { linear_mm: 100",
                "name: right, joints: { linear_mm: 295.1", 0,
                "viewpoints[3].joints.linear_mm: 295.100 lies outside the soft limits of axis linear, 5.000 "
                "to 295.000 mm"},
        Mistake{"BelowASoftLimit", "rotation_deg: 0, tilt_deg: 54", "rotation_deg: 0, tilt_deg: -75.01", 0,
                "viewpoints[0].joints.tilt_deg: -75.010 lies outside the soft limits of axis tilt, -75.000 "
                "to 75.000 deg"},
        Mistake{"TwoOfOneName", "name: back-right", "name: right", 0,
                "viewpoints[4].name: two viewpoints are called 'right'"},
        Mistake{"NeitherJointsNorSensor", kTop, "{ name: top }", 0,
                "viewpoint 'top' needs either 'joints' or 'sensor'"},
        Mistake{"JointsAndSensor", kTop,
                "{ name: top, sensor: {}, joints: { linear_mm: 100, rotation_deg: 0, tilt_deg: 54 } }", 0,
                "viewpoint 'top' needs either 'joints' or 'sensor'"},
        Mistake{
            "OutOfReach", kTop,
            "{ name: top, sensor: { position_mm: [60, 0, 5000], look_at_mm: [60, 0, 0] } }", 0,
            "viewpoints[0].sensor.position_mm: no joint positions within the soft limits reach this view"},
        // 5 mm beside the rotation axis, which every view of this chain meets: position or direction must
        // give way.
        Mistake{"PositionOutOfReach", kTop,
                "{ name: top, sensor: { position_mm: [65, -393.2, 300.3], look_at_mm: [65, 0, 25], "
                "position_tolerance_mm: 0.1, direction_tolerance_deg: 2 } }",
                0, "viewpoints[0].sensor.position_mm: no joint positions"},
        Mistake{"DirectionOutOfReach", kTop,
                "{ name: top, sensor: { position_mm: [65, -393.2, 300.3], look_at_mm: [65, 0, 25], "
                "position_tolerance_mm: 2, direction_tolerance_deg: 0.1 } }",
                0, "viewpoints[0].sensor.position_mm: no joint positions"},
        Mistake{"LooksAtItself", kTop,
                "{ name: top, sensor: { position_mm: [60, 0, 500], look_at_mm: [60, 0, 500] } }", 0,
                "viewpoints[0].sensor.look_at_mm"},
        Mistake{"MissingJoint", ", tilt_deg: 54", "", 0, "viewpoints[0].joints: missing key 'tilt_deg'"},
        Mistake{"UnknownJoint", "tilt_deg: 54", "tilt_deg: 54, roll_deg: 1", 0,
                "viewpoints[0].joints.roll_deg"},
        Mistake{"UnknownKey", "name: top,", "name: top, colour: red,", 0, "viewpoints[0].colour"},
        Mistake{"NoExposureTime", "name: top,", "name: top, exposure_ms: 0,", 0,
                "viewpoints[0].exposure_ms"}),
    mistake_name);

INSTANTIATE_TEST_SUITE_P(Rest, PlanMistake,
                         testing::Values(Mistake{"NotANumber", "tolerance_mm: 0.2", "tolerance_mm: fine", 0,
                                                 "inspection.tolerance_mm"},
                                         Mistake{"NoTolerance", "tolerance_mm: 0.2", "tolerance_mm: 0", 0,
                                                 "inspection.tolerance_mm"},
                                         Mistake{"UnknownKey", "exposure_ms: 100",
                                                 "exposure: 3\nexposure_ms: 100", 0, "exposure"},
                                         Mistake{"NoName", "name: bracket\n", "\n", 1, "missing key 'name'"}),
                         mistake_name);

}  // namespace
}  // namespace gantry
