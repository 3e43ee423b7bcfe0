#include "gantry/acquisition/collision_settings.h"

#include <gtest/gtest.h>

#include <numbers>

#include "acquisition/edited_file.h"
#include "gantry/acquisition/cell.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/kinematics/collision_shapes.h"

namespace gantry {
namespace {

const std::filesystem::path kCells = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/cells";

TEST(CollisionSettings, TheShippedCellsHaveTheSameBodies) {
  for (const char* file : {"simulated.yaml", "twin.yaml"}) {
    const Cell cell = read_cell(kCells / file);
    ASSERT_TRUE(cell.collision) << file;
    const CellCollision& collision = *cell.collision;
    EXPECT_EQ(collision.options.clearance_mm, 10);
    EXPECT_EQ(collision.options.path_deviation.size(), 3u);
    EXPECT_NEAR(collision.options.path_deviation[2], 0.5 * std::numbers::pi / 180, 1e-12);
    EXPECT_EQ(collision.part, Simplification::kConvexHull);
    EXPECT_EQ(collision.fixture, Simplification::kNone);
    ASSERT_EQ(collision.bodies.size(), 8u);
    EXPECT_EQ(collision.bodies[0].carrier, Carrier::kSensor);
    EXPECT_EQ(collision.bodies[6].name, "turntable");
    EXPECT_EQ(collision.bodies[6].carrier, Carrier::kCarriage);
    EXPECT_EQ(collision.bodies[6].joint, 1u);
    EXPECT_EQ(collision.bodies[6].shapes.size(), 4u);
  }
}

TEST(CollisionSettings, PartAndFixtureJoinAndMayTouchFollowsThem) {
  Cell cell = read_cell(kCells / "simulated.yaml");
  const TriangleMesh part = read_mesh(kCells / "../parts/bracket.stl");
  const auto bodies = [&](const TriangleMesh* with_part) {
    std::set<std::string> names;
    for (const auto& [a, b] : make_collision_model(cell, with_part, nullptr).pairs()) names.insert({a, b});
    return names;
  };
  EXPECT_FALSE(bodies(nullptr).contains("part"));
  EXPECT_TRUE(bodies(&part).contains("part"));
  cell.collision->options.may_touch.emplace_back("part", "rear brace");
  for (const auto& [a, b] : make_collision_model(cell, &part, nullptr).pairs())
    EXPECT_FALSE((a == "part" && b == "rear brace") || (a == "rear brace" && b == "part"));
  make_collision_model(cell, nullptr, nullptr);  // a pair of a part that is not there is no mistake
}

TEST(CollisionSettings, ShapesStandWhereTheyAreSaidTo) {
  Cell cell = read_cell(kCells / "simulated.yaml");
  cell.collision->bodies = {
      {"post", Carrier::kFrame, 0, {}},
      {"lever", Carrier::kCarriage, 0, {}},
  };
  cell.collision->options = {};
  cell.collision->options.clearance_mm = 0;
  CollisionShape box;
  box.size_mm = {10, 10, 10};
  CollisionShape lying;  // a cylinder along y, 100 long: from y = 250 to 350
  lying.kind = CollisionShape::Kind::kCylinder;
  lying.radius_mm = 5;
  lying.height_mm = 100;
  lying.body_from_shape = pose_from_position_rpy({0, 300, 0}, {std::numbers::pi / 2, 0, 0});
  cell.collision->bodies[0].shapes = {lying};
  cell.collision->bodies[1].shapes = {box};
  const CollisionModel model = make_collision_model(cell, nullptr, nullptr);
  const auto nearest = model.nearest_pair(std::vector<double>{100.0, 0.0, 0.0});
  ASSERT_TRUE(nearest);
  EXPECT_NEAR(nearest->clearance_mm, 250 - 105, 1e-3);
}

TEST(CollisionSettings, AMeshIsReadAndMadeCoarse) {
  Cell cell = read_cell(kCells / "simulated.yaml");
  CollisionShape holder;
  holder.kind = CollisionShape::Kind::kMesh;
  holder.file = kCells / "../parts/holder.stl";
  CollisionShape wall;
  wall.size_mm = {10, 200, 10};
  // The holder is a plate below (x 10 to 110, z -60 to -50) with a post in its middle: the wall beside the
  // post, at z = -20, is 15 mm inside the holder's box and hull, but free of the holder itself.
  wall.body_from_shape.translation() = Eigen::Vector3d(90, 0, -20);
  cell.collision->options = {};
  cell.collision->bodies = {{"wall", Carrier::kFrame, 0, {wall}},
                            {"holder", Carrier::kCarriage, 2, {holder}}};
  const std::vector<double> zero(3);
  const auto clearance = [&](Simplification how) {
    cell.collision->bodies[1].shapes[0].simplified = how;
    return make_collision_model(cell, nullptr, nullptr).nearest_pair(zero)->clearance_mm;
  };
  EXPECT_GT(clearance(Simplification::kNone), 10);
  EXPECT_LT(clearance(Simplification::kConvexHull), clearance(Simplification::kNone));
  EXPECT_EQ(clearance(Simplification::kBoundingBox), 0);
  cell.collision->bodies[1].shapes[0].file = "/nowhere/holder.stl";
  EXPECT_THROW(make_collision_model(cell, nullptr, nullptr), InputError);
}

class CollisionMistake : public testing::TestWithParam<Mistake> {};

TEST_P(CollisionMistake, IsRefusedWithFileLineAndKey) {
  expect_named(GetParam(), kCells / "simulated.yaml", [](const auto& path) { read_cell(path); });
}

INSTANTIATE_TEST_SUITE_P(
    Collision, CollisionMistake,
    testing::Values(
        Mistake{"NegativeClearance", "clearance_mm: 10", "clearance_mm: -1", 0, "collision.clearance_mm"},
        Mistake{"UnknownCarrier", "rides_on: tilt", "rides_on: tlit", 0,
                "collision.bodies[7].rides_on: expected one of frame, sensor, part, linear, rotation, tilt"},
        Mistake{"UnknownShape", "kind: cylinder", "kind: cone", 0, "collision.bodies[6].shapes[0].kind"},
        Mistake{"FlatBox", "size_mm: [740, 40, 40]", "size_mm: [740, 0, 40]", 0, "shapes[0].size_mm"},
        Mistake{"NegativeRadius", "radius_mm: 70", "radius_mm: -70", 0, "shapes[0].radius_mm"},
        Mistake{"HeightOfABox", "size_mm: [740, 40, 40]", "height_mm: 3, size_mm: [740, 40, 40]", 0,
                "shapes[0].height_mm: unknown key"},
        Mistake{"TwoOfOneName", "name: rear brace", "name: table", 0, "collision.bodies[3].name"},
        Mistake{"NameOfThePart", "name: rear brace", "name: part", 0, "collision.bodies[3].name"},
        Mistake{"UnknownPair", "first: guide", "first: giude", 0,
                "collision.may_touch[0].first: there is no body 'giude'"},
        Mistake{"TouchingItself", "first: guide, second: carriage", "first: guide, second: guide", 0,
                "collision.may_touch[0].second"},
        Mistake{"DeviationOfTheWrongUnit", "rotation_deg: 0.5", "rotation_mm: 0.5", 0,
                "collision.path_deviation.rotation_mm: unknown key"},
        Mistake{"UnknownSimplification", "simplified: convex_hull", "simplified: hull", 0,
                "collision.part.simplified"}),
    mistake_name);

class SafetyMistake : public testing::TestWithParam<Mistake> {};

TEST_P(SafetyMistake, IsRefusedWithFileLineAndKey) {
  expect_named(GetParam(), kCells / "twin.yaml", [](const auto& path) { read_cell(path); });
}

INSTANTIATE_TEST_SUITE_P(
    Safety, SafetyMistake,
    testing::Values(
        Mistake{"UnknownModule", "kind: modbus", "kind: profisafe", 0, "safety.module.kind"},
        Mistake{"AddressOfSimulatedInputs", "kind: modbus", "kind: simulated", 0, "safety.module.host"},
        Mistake{"ModuleUnitOutOfRange", "unit: 10", "unit: 0", 0, "safety.module.unit"},
        Mistake{"AgeBelowThePolling", "max_age_ms: 100", "max_age_ms: 30", 0,
                "safety.max_age_ms: must be at least"},
        Mistake{"AgeBelowTheTimeout", "unit: 10", "unit: 10, response_timeout_ms: 100", 2,
                "safety.max_age_ms: must be larger"},
        Mistake{"CategoryTwo", "stop_category: 0", "stop_category: 2", 0, "safety.inputs[0].stop_category"},
        Mistake{"NoCategory", ", stop_category: 0", "", 0, "missing key 'stop_category'"},
        Mistake{"ThreeChannels", "channels: [0, 1]", "channels: [0, 1, 6]", 0, "safety.inputs[0].channels"},
        Mistake{"HalfAChannel", "channels: [0, 1]", "channels: [0, 1.5]", 0, "safety.inputs[0].channels"},
        Mistake{"DiscrepancyOfOneChannel", "channels: [0, 1]", "channels: [0]", 0,
                "safety.inputs[0].discrepancy_ms"},
        Mistake{"ChannelTwice", "channels: [2, 3]", "channels: [2, 1]", -2, "channel 1 is used twice"},
        Mistake{"NameTwice", "name: door", "name: emergency stop", -2,
                "'emergency stop': names must differ"}),
    mistake_name);

TEST(SafetySettings, TheShippedCellsHaveThreeInputsOfTwoChannels) {
  const CellSafety twin = read_cell(kCells / "twin.yaml").safety.value();
  const CellSafety simulated = read_cell(kCells / "simulated.yaml").safety.value();
  EXPECT_EQ(twin.module.kind, "modbus");
  EXPECT_EQ(twin.module.port, 15023);
  EXPECT_EQ(twin.module.unit, 10);
  EXPECT_EQ(simulated.module.kind, "simulated");
  for (const CellSafety& safety : {twin, simulated}) {
    EXPECT_DOUBLE_EQ(safety.poll_s, 0.02);
    EXPECT_DOUBLE_EQ(safety.chain.max_age_s, 0.1);
    EXPECT_DOUBLE_EQ(safety.chain.ramp_limit_s, 1.5);
    ASSERT_EQ(safety.chain.inputs.size(), 3u);
    EXPECT_EQ(safety.chain.channel_count(), 6u);
    EXPECT_EQ(safety.chain.inputs[0].name, "emergency stop");
    EXPECT_EQ(safety.chain.inputs[0].stop, StopCategory::kCategory0);
    EXPECT_EQ(safety.chain.inputs[1].stop, StopCategory::kCategory1);
    EXPECT_DOUBLE_EQ(safety.chain.inputs[1].discrepancy_s, 0.5);
    EXPECT_DOUBLE_EQ(safety.chain.inputs[1].release_s, 0.1);
  }
}

}  // namespace
}  // namespace gantry
