#include "gantry/acquisition/plan_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "gantry/acquisition/collision_settings.h"
#include "gantry/geometry/mesh_file.h"

namespace gantry {
namespace {

const std::filesystem::path kExamples = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples";
constexpr double kDeg = std::numbers::pi / 180;

struct ShippedCell {
  Cell cell = read_cell(kExamples / "cells/simulated.yaml");
  Plan plan = read_plan(kExamples / "plans/bracket.yaml", cell);
  TriangleMesh part = read_mesh(kExamples / "parts/bracket.stl");
  TriangleMesh fixture = read_mesh(cell.fixture);

  void add(const std::string& name, double linear_mm, double rotation_deg, double tilt_deg) {
    plan.viewpoints.push_back({name, {linear_mm, rotation_deg * kDeg, tilt_deg * kDeg}, 0.1, 0});
  }
  CollisionModel model() const { return make_collision_model(cell, &part, &fixture); }
};

TEST(PlanCheck, TheShippedPlanIsFree) {
  const ShippedCell shipped;
  require_collision_free(shipped.cell, shipped.plan, &shipped.part, &shipped.fixture);
  const auto nearest = shipped.model().nearest_pair(shipped.plan.viewpoints[0].q);
  ASSERT_TRUE(nearest);
  EXPECT_GT(nearest->clearance_mm, 10);
}

TEST(PlanCheck, AViewpointBehindAnObstacleIsRefusedByNameWithThePairAndThePlace) {
  // At 290 mm the fork of the turntable, turned to the rear, reaches y = 285; the rear brace begins at 270.
  ShippedCell shipped;
  shipped.add("too far", 290, 90, 0);
  expect_input_error(
      [&] { require_collision_free(shipped.cell, shipped.plan, &shipped.part, &shipped.fixture); },
      {"bracket.yaml", "viewpoint 'too far' is refused", "on the way from 'below-front-left'", "'turntable'",
       "'rear brace'", "come within", "mm are needed, at linear ", " mm, rotation ", " deg, tilt ",
       "nothing has moved"});
}

TEST(PlanCheck, AMoveBetweenTwoFreeViewpointsThatSwingsThroughAnObstacleIsRefused) {
  ShippedCell shipped;
  shipped.plan.viewpoints.clear();
  shipped.add("rear", 290, 0, 0);
  EXPECT_FALSE(first_collision(shipped.cell, shipped.plan, shipped.model()));
  shipped.add("turned round", 290, 180, 0);
  const CollisionModel model = shipped.model();
  EXPECT_FALSE(model.first_on_path(shipped.plan.viewpoints[1].q, shipped.plan.viewpoints[1].q));
  const auto found = first_collision(shipped.cell, shipped.plan, model);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->from, "rear");
  EXPECT_EQ(found->to, "turned round");
  EXPECT_EQ(found->collision.first, "turntable");
  EXPECT_EQ(found->collision.second, "rear brace");
  // The fork's outer corner, (93, 20) from the axis at y = 190, comes to y = 270 - 10 - what the axes may be
  // out of step: 1 mm and 0.5 degrees of its bounding box's radius (93.02 on the axis of the box: 95.1).
  const double slack_mm = 1 + 0.5 * kDeg * std::hypot(93, 70);
  const double corner = std::atan2(20, 93), reach = std::hypot(20, 93);
  EXPECT_NEAR(found->collision.q[1], std::asin((260 - slack_mm - 190) / reach) - corner, 0.01);
}

TEST(PlanCheck, AViewpointThatIsDoneIsLeftOut) {
  ShippedCell shipped;
  shipped.add("too far", 290, 90, 0);
  const int last = static_cast<int>(shipped.plan.viewpoints.size()) - 1;
  EXPECT_TRUE(first_collision(shipped.cell, shipped.plan, shipped.model()));
  EXPECT_FALSE(first_collision(shipped.cell, shipped.plan, shipped.model(), {last}));
  // And the way that a resumed run takes instead is the one that is checked: from home.
  std::set<int> all_but_last;
  for (int k = 0; k < last; ++k) all_but_last.insert(k);
  EXPECT_EQ(first_collision(shipped.cell, shipped.plan, shipped.model(), all_but_last)->from, "home");
}

TEST(PlanCheck, ACellWithoutACollisionSectionIsNotChecked) {
  ShippedCell shipped;
  shipped.cell.collision.reset();
  shipped.add("too far", 290, 90, 0);
  require_collision_free(shipped.cell, shipped.plan, &shipped.part, &shipped.fixture);
}

TEST(PlanCheck, TheCheckOfOneMoveIsAFaultThatNamesThePair) {
  const ShippedCell shipped;
  const CollisionModel model = shipped.model();
  const auto check = make_path_check(shipped.cell, model);
  const std::vector<double> home = home_position(shipped.cell), far{290, 90 * kDeg, 0};
  EXPECT_TRUE(check(home, shipped.plan.viewpoints[0].q));
  const auto refused = check(home, far);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  EXPECT_NE(refused.error().text().find("'rear brace'"), std::string::npos);
}

TEST(PlanCheck, ThePathBeginsWhereHomingEnds) {
  ShippedCell shipped;
  EXPECT_EQ(home_position(shipped.cell), (std::vector<double>{0, 0, 0}));
  EXPECT_FALSE(first_collision(shipped.cell, shipped.plan, shipped.model()));
  shipped.cell.axes[0].limits.position_at_home = 290;
  shipped.cell.axes[1].limits.position_at_home = 90 * kDeg;
  const auto found = first_collision(shipped.cell, shipped.plan, shipped.model());
  ASSERT_TRUE(found);
  EXPECT_EQ(found->from, "home");
  EXPECT_EQ(found->collision.at, 0);
}

}  // namespace
}  // namespace gantry
