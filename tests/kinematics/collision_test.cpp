#include "gantry/kinematics/collision.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "foundation/expect_input_error.h"
#include "gantry/kinematics/collision_shapes.h"
#include "kinematics/brute_meshes.h"

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kTolerance_mm = 0.01;

TriangleMesh at(const TriangleMesh& mesh, const Eigen::Vector3d& position_mm) {
  Pose pose = Pose::Identity();
  pose.translation() = position_mm;
  return transformed(mesh, pose);
}

/// A carriage along x.
Chain linear_axis() {
  Chain chain;
  Joint joint;
  joint.name = "linear";
  joint.kind = JointKind::kPrismatic;
  joint.direction = {1, 0, 0};
  chain.joints = {joint};
  return chain;
}

/// A turntable about z through the origin.
Chain turntable() {
  Chain chain;
  Joint joint;
  joint.name = "rotation";
  joint.direction = {0, 0, 1};
  chain.joints = {joint};
  return chain;
}

CollisionOptions options(double clearance_mm) {
  CollisionOptions result;
  result.clearance_mm = clearance_mm;
  result.tolerance_mm = kTolerance_mm;
  return result;
}

const std::vector<double> kZero{0.0};

TEST(Collision, BoxOnALinearAxisStopsTheClearanceShortOfAWall) {
  // The box's front is at x = 10 + q, the wall's face at x = 95.
  const CollisionModel model(linear_axis(),
                             {{"wall", Carrier::kFrame, 0, at(box_mesh({10, 200, 200}), {100, 0, 0})},
                              {"box", Carrier::kCarriage, 0, box_mesh({20, 20, 20})}},
                             options(5));
  const std::vector<double> far{200.0}, short_of_it{79.9}, into_it{80.1};
  EXPECT_FALSE(model.first_on_path(kZero, short_of_it));
  EXPECT_TRUE(model.first_on_path(kZero, into_it));
  const auto found = model.first_on_path(kZero, far);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->first, "box");
  EXPECT_EQ(found->second, "wall");
  EXPECT_NEAR(found->q[0], 80, 2 * kTolerance_mm);
  EXPECT_NEAR(found->at, 0.4, 2 * kTolerance_mm / 200);
  EXPECT_NEAR(found->clearance_mm, 5, 2 * kTolerance_mm);
  EXPECT_GE(found->clearance_mm, 5) << "found from the safe side";
  EXPECT_NEAR(found->demanded_mm, 5 + kTolerance_mm, 1e-9);
  // And from the other side of the wall.
  const auto back = model.first_on_path(far, kZero);
  ASSERT_TRUE(back);
  EXPECT_NEAR(back->q[0], 120, 2 * kTolerance_mm);
}

TEST(Collision, ThinObstacleIsNotSteppedOver) {
  // A sheet of 0.02 mm, and a path of 10 m: any sampling by less than half a million steps may miss it.
  const CollisionModel model(linear_axis(),
                             {{"sheet", Carrier::kFrame, 0, at(box_mesh({0.02, 50, 50}), {4321.5, 0, 0})},
                              {"needle", Carrier::kCarriage, 0, box_mesh({0.02, 1, 1})}},
                             options(0));
  const std::vector<double> far{10000.0};
  const auto found = model.first_on_path(kZero, far);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->q[0], 4321.48, 3 * kTolerance_mm);
}

TEST(Collision, ThinPostIsFoundOnTheCircleOfAnArm) {
  // An arm from the axis to radius 300, 2 mm wide; the post stands at radius 299 and 90 degrees.
  const CollisionModel model(turntable(),
                             {{"post", Carrier::kFrame, 0, at(box_mesh({0.5, 0.5, 100}), {0, 299, 0})},
                              {"arm", Carrier::kCarriage, 0, at(box_mesh({300, 2, 10}), {150, 0, 0})}},
                             options(0));
  const std::vector<double> turned{kPi};
  const auto found = model.first_on_path(kZero, turned);
  ASSERT_TRUE(found);
  // The arm's leading corner (300, 1) reaches the post's right edge at x = 0.25, or its side at radius ~299
  // does.
  EXPECT_NEAR(found->q[0], kPi / 2 - std::atan2(1.25, 299), 2e-4);
}

TEST(Collision, ReachOfAnArmIsItsRadiusAndNoLess) {
  // A ball of radius 10 (as its mesh: up to 2 percent more) on radius 100 passes a wall whose face is at
  // x = 100 + 10 + clearance + gap: free for a gap beyond what the mesh adds, not free for a negative one.
  for (const double gap : {-0.3, 0.3}) {
    const CollisionModel model(turntable(),
                               {{"wall", Carrier::kFrame, 0, at(box_mesh({10, 600, 60}), {120 + gap, 0, 0})},
                                {"ball", Carrier::kCarriage, 0, at(sphere_mesh(10), {0, 100, 0})}},
                               options(5));
    const std::vector<double> left{-kPi}, right{kPi};
    EXPECT_EQ(model.first_on_path(left, right).has_value(), gap < 0) << gap;
  }
}

TEST(Collision, RotatingBoxTouchesAWallAtTheAngleOfItsCorner) {
  // A square of half width 50 turns beside a wall at x = 60: its corner (radius 50 sqrt 2) is at x = 60 when
  // cos(angle of the corner) = 60 / 70.71.
  const CollisionModel model(turntable(),
                             {{"wall", Carrier::kFrame, 0, at(box_mesh({10, 600, 60}), {65, 0, 0})},
                              {"square", Carrier::kCarriage, 0, box_mesh({100, 100, 10})}},
                             options(0));
  const std::vector<double> turned{kPi / 2};
  const auto found = model.first_on_path(kZero, turned);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->q[0], kPi / 4 - std::acos(60 / (50 * std::sqrt(2.0))), 5e-4);
}

TEST(Collision, SolidInsideASolidIsACollisionThoughTheirSurfacesAreApart) {
  const TriangleMesh small = box_mesh({4, 4, 4}), big = box_mesh({100, 100, 100});
  const std::vector<double> q{1.0};
  for (const bool carried_is_small : {true, false}) {
    const CollisionModel model(linear_axis(),
                               {{"fixed", Carrier::kFrame, 0, carried_is_small ? big : small},
                                {"carried", Carrier::kCarriage, 0, carried_is_small ? small : big}},
                               options(1));
    const auto found = model.first_on_path(kZero, q);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->at, 0);
    EXPECT_EQ(found->clearance_mm, 0);
  }
  // In the hollow of a hollow box there is room.
  TriangleMesh hollow = box_mesh({80, 80, 80});
  for (Eigen::Vector3i& triangle : hollow.triangles) std::swap(triangle[1], triangle[2]);
  const CollisionModel model(
      linear_axis(),
      {{"housing", Carrier::kFrame, 0, merged(big, hollow)}, {"carried", Carrier::kCarriage, 0, small}},
      options(1));
  EXPECT_FALSE(model.first_on_path(kZero, q));
}

TEST(Collision, ThatASecondShellIsInsideIsSeenToo) {
  const CollisionModel model(
      linear_axis(),
      {{"block", Carrier::kFrame, 0, box_mesh({100, 100, 100})},
       {"pair", Carrier::kCarriage, 0, merged(at(box_mesh({4, 4, 4}), {300, 0, 0}), box_mesh({4, 4, 4}))}},
      options(1));
  EXPECT_TRUE(model.first_on_path(kZero, kZero));
}

TEST(Collision, WhatRidesTogetherOrMayTouchIsNotChecked) {
  Chain chain = linear_axis();
  const TriangleMesh cube = box_mesh({10, 10, 10});
  CollisionOptions touching = options(5);
  touching.may_touch = {{"guide", "carriage"}};
  const CollisionModel model(chain,
                             {{"guide", Carrier::kFrame, 0, cube},
                              {"sensor", Carrier::kSensor, 0, at(cube, {0, 50, 0})},
                              {"carriage", Carrier::kCarriage, 0, cube},
                              {"part", Carrier::kPart, 0, cube}},
                             touching);
  const std::vector<std::pair<std::string, std::string>> expected{
      {"guide", "part"}, {"sensor", "carriage"}, {"sensor", "part"}};
  EXPECT_EQ(model.pairs(), expected);
  const auto found = model.first_on_path(kZero, kZero);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->first, "part");
  EXPECT_EQ(found->second, "guide");
}

TEST(Collision, FirstOfSeveralIsReported) {
  const TriangleMesh cube = box_mesh({10, 10, 10});
  for (const bool near_first : {true, false}) {
    std::vector<CollisionBody> bodies{{"near", Carrier::kFrame, 0, at(cube, {50, 0, 0})},
                                      {"far", Carrier::kFrame, 0, at(cube, {52, 0, 0})}};
    if (!near_first) std::swap(bodies[0], bodies[1]);
    bodies.push_back({"cube", Carrier::kCarriage, 0, cube});
    const CollisionModel model(linear_axis(), bodies, options(2));
    const std::vector<double> far{200.0};
    const auto found = model.first_on_path(kZero, far);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->second, "near");
    EXPECT_NEAR(found->q[0], 38, 2 * kTolerance_mm);
  }
}

TEST(Collision, AxesOutOfStepAreAllowedForByTheirReach) {
  // A turning arm of radius 200 beside a wall 8 mm away: 0.02 rad out of step may move its end by 4 mm.
  const auto found_with = [](double deviation, double clearance_mm) {
    CollisionOptions with = options(clearance_mm);
    with.path_deviation = {deviation};
    const CollisionModel model(turntable(),
                               {{"wall", Carrier::kFrame, 0, at(box_mesh({300, 10, 10}), {150, 14, 0})},
                                {"arm", Carrier::kCarriage, 0, at(box_mesh({200, 2, 10}), {100, 0, 0})}},
                               with);
    return model.first_on_path(kZero, kZero).has_value();
  };
  EXPECT_FALSE(found_with(0, 7.9));
  EXPECT_TRUE(found_with(0, 8.1));
  EXPECT_FALSE(found_with(0.02, 3.9));
  EXPECT_TRUE(found_with(0.02, 4.1));
}

TEST(Collision, APathThatGrazesTheLimitForMetresComesToAnEnd) {
  // Both faces stay apart by a thousandth of a millimetre more than is demanded: nothing is hit, but to prove
  // it over 100 m would take ten million steps. The answer is a refusal that says so, soon.
  const double gap_mm = 5 + kTolerance_mm + 0.001;
  const CollisionModel model(
      linear_axis(),
      {{"rail", Carrier::kFrame, 0, at(box_mesh({400'000, 10, 10}), {0, -5 - gap_mm, 0})},
       {"slide", Carrier::kCarriage, 0, at(box_mesh({10, 10, 10}), {0, 5, 0})}},
      options(5));
  const std::vector<double> near_by{100.0}, far{100'000.0};
  EXPECT_FALSE(model.first_on_path(kZero, near_by));
  const auto found = model.first_on_path(kZero, far);
  ASSERT_TRUE(found);
  EXPECT_GT(found->clearance_mm, found->demanded_mm);
  EXPECT_GT(found->q[0], 100);
}

TEST(Collision, WrongModelsAreRefusedByName) {
  const TriangleMesh cube = box_mesh({10, 10, 10});
  const auto model = [&](std::vector<CollisionBody> bodies, const CollisionOptions& with) {
    CollisionModel(linear_axis(), std::move(bodies), with);
  };
  expect_input_error(
      [&] {
        model({{"a", Carrier::kFrame, 0, cube}, {"a", Carrier::kPart, 0, cube}}, {});
      },
      {"'a'"});
  expect_input_error([&] { model({{"empty", Carrier::kFrame, 0, {}}}, {}); }, {"'empty'", "no triangles"});
  expect_input_error([&] { model({{"b", Carrier::kCarriage, 1, cube}}, {}); }, {"'b'", "joint"});
  TriangleMesh broken = cube;
  broken.vertices[3].x() = std::nanf("");
  expect_input_error([&] { model({{"c", Carrier::kFrame, 0, broken}}, {}); }, {"'c'", "no number"});
  broken = cube;
  broken.triangles[0][1] = 8;
  expect_input_error([&] { model({{"d", Carrier::kFrame, 0, broken}}, {}); }, {"'d'"});
  CollisionOptions with;
  with.may_touch = {{"a", "ghost"}};
  expect_input_error([&] { model({{"a", Carrier::kFrame, 0, cube}}, with); }, {"may_touch", "'ghost'"});
  with = {};
  with.clearance_mm = -1;
  expect_input_error([&] { model({}, with); }, {"clearance_mm"});
  with = {};
  with.path_deviation = {0, 0};
  expect_input_error([&] { model({}, with); }, {"path_deviation"});
  const CollisionModel good(linear_axis(), {{"a", Carrier::kFrame, 0, cube}}, {});
  const std::vector<double> two{0, 0}, nan{std::nan("")};
  EXPECT_THROW(good.first_on_path(kZero, two), std::invalid_argument);
  EXPECT_THROW(good.first_on_path(nan, kZero), std::invalid_argument);
}

// ---- Against brute force ------------------------------------------------------------------------

/// Three joints as in the demo cell, with directions and points of their own.
Chain random_chain(std::mt19937_64& random) {
  std::normal_distribution<double> gauss;
  const auto vector = [&](double scale) -> Eigen::Vector3d {
    return Eigen::Vector3d(gauss(random), gauss(random), gauss(random)) * scale;
  };
  Chain chain;
  for (int j = 0; j < 3; ++j) {
    Joint joint;
    joint.name = std::string(1, static_cast<char>('a' + j));
    joint.kind = random() % 3 == 0 ? JointKind::kPrismatic : JointKind::kRevolute;
    joint.direction = vector(1).normalized();
    joint.point_mm = vector(40);
    chain.joints.push_back(joint);
  }
  chain.base_from_part_at_zero.translation() = vector(30);
  chain.base_from_sensor = pose_from_position_rpy(vector(150), vector(1));
  return chain;
}

struct Scene {
  Chain chain;
  std::vector<CollisionBody> bodies;
  std::vector<double> from, to;
};

Scene random_scene(uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> size(2, 60);
  Scene scene;
  scene.chain = random_chain(random);
  const auto box = [&](double spread) {
    return transformed(
        box_mesh({size(random), size(random), size(random)}),
        pose_from_position_rpy({gauss(random) * spread, gauss(random) * spread, gauss(random) * spread},
                               {gauss(random), gauss(random), gauss(random)}));
  };
  scene.bodies = {{"frame", Carrier::kFrame, 0, merged(box(150), box(150))},
                  {"sensor", Carrier::kSensor, 0, box(20)},
                  {"carriage", Carrier::kCarriage, random() % 3, box(60)},
                  {"part", Carrier::kPart, 0, merged(box(30), box(30))}};
  for (const Joint& joint : scene.chain.joints) {
    const double scale = joint.kind == JointKind::kPrismatic ? 60 : 1;
    scene.from.push_back(gauss(random) * scale);
    scene.to.push_back(gauss(random) * scale);
  }
  return scene;
}

/// The body where it stands at q, base frame; by the joints one after the other, not by CollisionModel.
TriangleMesh placed(const Scene& scene, const CollisionBody& body, std::span<const double> q) {
  if (body.carrier == Carrier::kFrame) return body.mesh;
  if (body.carrier == Carrier::kSensor) return transformed(body.mesh, scene.chain.base_from_sensor);
  if (body.carrier == Carrier::kPart) return transformed(body.mesh, scene.chain.base_from_part(q));
  TriangleMesh mesh = body.mesh;
  for (size_t j = body.joint + 1; j-- > 0;)
    mesh = transformed(mesh, pose_exp(scene.chain.joints[j].twist() * q[j]));
  return mesh;
}

/// Smallest distance of any pair that moves against each other.
double brute_nearest(const Scene& scene, const CollisionModel& model, std::span<const double> q) {
  double nearest = 1e300;
  for (const auto& [a, b] : model.pairs()) {
    const auto mesh = [&](const std::string& name) {
      const auto body = std::find_if(scene.bodies.begin(), scene.bodies.end(),
                                     [&](const CollisionBody& each) { return each.name == name; });
      return placed(scene, *body, q);
    };
    nearest = std::min(nearest, testing::brute_distance(mesh(a), mesh(b)));
  }
  return nearest;
}

TEST(CollisionAgainstBruteForce, DistancesOfPairsAgree) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const Scene scene = random_scene(seed);
    const CollisionModel model(scene.chain, scene.bodies, options(1));
    const auto nearest = model.nearest_pair(scene.from);
    ASSERT_TRUE(nearest);
    const double brute = brute_nearest(scene, model, scene.from);
    // A solid inside another counts as touching, whatever its surface says.
    if (nearest->clearance_mm > 0) {
      EXPECT_NEAR(nearest->clearance_mm, brute, 1e-3) << "seed " << seed;
    }
  }
}

TEST(CollisionAgainstBruteForce, PathsAreJudgedAsFineSamplingJudgesThem) {
  constexpr int kSamples = 60;
  constexpr double kClearance_mm = 4;
  int colliding = 0, free = 0, later = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const Scene scene = random_scene(1000 + seed);
    const CollisionModel model(scene.chain, scene.bodies, options(kClearance_mm));
    const auto q_at = [&](double s) {
      std::vector<double> q;
      for (size_t j = 0; j < 3; ++j) q.push_back(scene.from[j] + s * (scene.to[j] - scene.from[j]));
      return q;
    };
    const auto found = model.first_on_path(scene.from, scene.to);
    if (!found) {
      ++free;
      for (int k = 0; k <= kSamples; ++k)
        ASSERT_GE(brute_nearest(scene, model, q_at(k / double{kSamples})), kClearance_mm - 1e-3)
            << "missed: seed " << seed << " sample " << k;
      continue;
    }
    ++colliding;
    later += found->at > 0;
    // What is reported is true where it is reported ...
    for (size_t j = 0; j < 3; ++j) EXPECT_NEAR(found->q[j], q_at(found->at)[j], 1e-12);
    EXPECT_LE(found->clearance_mm, kClearance_mm + 2 * kTolerance_mm);
    if (found->clearance_mm > 0) {
      EXPECT_NEAR(found->clearance_mm, brute_nearest(scene, model, found->q), 1e-3) << "seed " << seed;
    }
    // ... and nothing came nearer before.
    for (int k = 0; k < kSamples && k / double{kSamples} < found->at; ++k)
      ASSERT_GE(brute_nearest(scene, model, q_at(k / double{kSamples})), kClearance_mm - 1e-3)
          << "not the first: seed " << seed << " sample " << k;
  }
  EXPECT_GT(colliding, 15);
  EXPECT_GT(later, 5);
  EXPECT_GT(free, 15);
}

}  // namespace
}  // namespace gantry
