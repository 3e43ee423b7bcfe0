#include "gantry/sim/world.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>

#include "gantry/acquisition/cell.h"
#include "gantry/foundation/error.h"

namespace gantry {
namespace {

const Cell& cell() {
  static const Cell cell =
      read_cell(std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/cells/simulated.yaml");
  return cell;
}

SimulationSettings settings() {
  StrictYaml yaml = StrictYaml::load(cell().file);
  SimulationSettings settings = read_simulation(yaml.map("simulation"), cell().chain);
  settings.sensor.width = 96;
  settings.sensor.height = 60;
  return settings;
}

/// A part that costs nothing to build.
TriangleMesh triangle() {
  return {{{50, -10, 0}, {50, 10, 0}, {70, 0, 0}}, {{0, 1, 2}}};
}

class World : public testing::Test {
 protected:
  std::unique_ptr<SimulatedWorld> make(uint64_t seed) {
    return std::make_unique<SimulatedWorld>(cell().chain, settings_, triangle(), std::nullopt, seed, clock_);
  }

  VirtualClock clock_;
  SimulationSettings settings_ = settings();
};

constexpr double kDeg = std::numbers::pi / 180;
/// Joint values as in the shipped plan.
const std::vector<double> kPositions[] = {{100, 0, 54 * kDeg},           {100, 45 * kDeg, 0},
                                          {100, 40 * kDeg, -66 * kDeg},  {100, 135 * kDeg, 0},
                                          {100, -140 * kDeg, 66 * kDeg}, {100, -90 * kDeg, 0}};
constexpr int kSeeds = 200;

/// Error of the nominal pose as UncertainPose defines it: exp(error) * nominal = true.
Vector6d pose_error(const SimulatedWorld& world, const std::vector<double>& q) {
  return pose_log(world.true_part_from_sensor_at(q) * cell().chain.part_from_sensor(q).inverse());
}

TEST_F(World, ForwardKinematicsIsGoodButNotPerfect) {
  // In the middle of the part.
  const Eigen::Vector3d place(60, 0, 20);
  double sum = 0;
  int n = 0, usual = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const auto world = make(seed);
    for (const auto& q : kPositions) {
      const double error_mm = (pose_exp(pose_error(*world, q)) * place - place).norm();
      usual += error_mm > 0.02 && error_mm < 0.6;
      sum += error_mm;
      ++n;
      EXPECT_LT(error_mm, 1.0) << "seed " << seed;
    }
  }
  EXPECT_GT(usual, 0.99 * n);
  EXPECT_GT(sum / n, 0.1);
  EXPECT_LT(sum / n, 0.3);
}

TEST_F(World, ItsErrorsAreThoseThatTheChainsCovarianceStates) {
  for (const auto& q : kPositions) {
    // Stages that stand exactly at q have no repeatability: the shared part is all.
    const Matrix6d covariance = cell().chain.uncertain_part_from_sensor(q).shared();
    const Eigen::LDLT<Matrix6d> information(covariance);
    double sum = 0, sum2 = 0;
    Vector6d mean = Vector6d::Zero();
    for (uint64_t seed = 0; seed < kSeeds; ++seed) {
      const Vector6d error = pose_error(*make(seed), q);
      const double squared = error.dot(information.solve(error));
      sum += squared;
      sum2 += squared * squared;
      mean += error / kSeeds;
    }
    // Chi-square with 6 degrees of freedom: mean 6, variance 12.
    EXPECT_NEAR(sum / kSeeds, 6, 4 * std::sqrt(12.0 / kSeeds));
    EXPECT_NEAR(sum2 / kSeeds - std::pow(sum / kSeeds, 2), 12, 8);
    EXPECT_LT(kSeeds * mean.dot(information.solve(mean)), 30) << "errors have mean 0";
  }
}

TEST_F(World, TheCadModelIsPlacedWithTheStatedSigma) {
  double rotation2 = 0, translation2 = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const Vector6d placement = pose_log(make(seed)->true_part_from_cad());
    rotation2 += placement.head<3>().squaredNorm() / (3 * kSeeds);
    translation2 += placement.tail<3>().squaredNorm() / (3 * kSeeds);
  }
  const double bound = 4 / std::sqrt(2.0 * 3 * kSeeds);
  EXPECT_NEAR(std::sqrt(rotation2) / settings_.placement_sigma_rad, 1, bound);
  EXPECT_NEAR(std::sqrt(translation2) / settings_.placement_sigma_mm, 1, bound);
}

TEST_F(World, TheTruthFollowsTheStagesAndNotTheirEncoders) {
  const auto world = make(3);
  std::vector<double> q;
  for (size_t i = 0; i < world->axis_count(); ++i) {
    world->stage(i).set_servo(true, 0);
    world->stage(i).start_move(kPositions[2][i], 1e3, 1e4, 0);
    q.push_back(world->stage(i).observe(100).true_position);
  }
  EXPECT_TRUE(world->true_part_from_sensor(100).isApprox(world->true_part_from_sensor_at(q), 1e-12));
  EXPECT_GT(translation_distance(world->true_part_from_sensor(0), world->true_part_from_sensor(100)), 1.0);
}

TEST_F(World, ExposingTakesItsTimeAndIsRepeatable) {
  const TriangleMesh part = {{{-500, -500, 0}, {500, -500, 0}, {0, 900, 0}}, {{0, 1, 2}}};
  const auto scans = [&](uint64_t seed) {
    VirtualClock clock;
    SimulatedWorld world(cell().chain, settings_, part, std::nullopt, seed, clock);
    for (size_t i = 0; i < world.axis_count(); ++i) {
      world.stage(i).set_servo(true, 0);
      world.stage(i).start_move(kPositions[0][i], 1e3, 1e4, 0);
    }
    clock.sleep_s(100);
    std::vector<float> depths;
    for (int k = 0; k < 2; ++k) {
      const double before_s = clock.now_s();
      const Scan scan = world.expose(0.25);
      EXPECT_NEAR(clock.now_s() - before_s, 0.25, 1e-12);
      EXPECT_GT(scan.valid_count(), scan.points.size() / 2);
      depths.push_back(scan.points[scan.index(48, 30)].z());
    }
    return depths;
  };
  EXPECT_EQ(scans(1), scans(1));
  EXPECT_NE(scans(1), scans(2));
  EXPECT_NE(scans(1)[0], scans(1)[1]) << "noise is drawn for each scan";
}

TEST_F(World, OneSeedOneWorld) {
  EXPECT_TRUE(make(4)->true_part_from_cad().isApprox(make(4)->true_part_from_cad(), 0));
  EXPECT_EQ(pose_error(*make(4), kPositions[1]), pose_error(*make(4), kPositions[1]));
  EXPECT_NE(pose_error(*make(4), kPositions[1]), pose_error(*make(5), kPositions[1]));
}

TEST(Simulation, MistakesInItsSectionAreNamed) {
  const auto message = [](const std::string& text) {
    try {
      read_simulation(StrictYaml::parse(text, "cell.yaml"), cell().chain);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  const std::string stage =
      "  - {travel_mm: [0, 300], max_speed_mm_s: 200, max_acceleration_mm_s2: 1000, homing_speed_mm_s: 100, "
      "encoder_resolution_mm: 0.01, repeatability_mm: 0.005}\n";
  EXPECT_NE(
      message("sensor: {}\npart: a.stl\nstages:\n" + stage).find("cell.yaml:3: stages: expected one entry"),
      std::string::npos);
  EXPECT_NE(message("sensor: {near_mm: 700, far_mm: 600}\n").find("cell.yaml:1: sensor.near_mm"),
            std::string::npos);
  EXPECT_NE(message("sensor: {\n  colour: red}\n").find("cell.yaml:2: sensor.colour"), std::string::npos);
  VirtualClock clock;
  SimulationSettings one_stage = settings();
  one_stage.stages.pop_back();
  EXPECT_THROW(SimulatedWorld(cell().chain, one_stage, triangle(), std::nullopt, 1, clock), InputError);
}

}  // namespace
}  // namespace gantry
