// The conformance suites on the devices of the simulation in this process.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "gantry/sim/devices.h"
#include "hal/axis_conformance.h"
#include "hal/scanner_conformance.h"

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;

Chain one_joint(JointKind kind) {
  Chain chain;
  chain.joints.resize(1);
  chain.joints[0].name = "stage";
  chain.joints[0].kind = kind;
  return chain;
}

/// A rectangle across the sensor's view at depth `z_mm`; no ray of the sensor below meets its rim.
constexpr double kHalfWidth_mm = 90, kHalfHeight_mm = 50;
TriangleMesh plate(float z_mm) {
  constexpr float x = kHalfWidth_mm, y = kHalfHeight_mm;
  return {{{-x, -y, z_mm}, {x, -y, z_mm}, {x, y, z_mm}, {-x, y, z_mm}}, {{0, 2, 1}, {0, 3, 2}}};
}

SimulationSettings settings_with(const StageDynamics& dynamics) {
  SimulationSettings settings;
  settings.stages = {dynamics};
  settings.sensor.width = 64;
  settings.sensor.height = 40;
  settings.sensor.noise_mm = settings.sensor.dropout_probability = settings.sensor.mixed_pixel_probability =
      0;
  settings.placement_sigma_mm = settings.placement_sigma_rad = 0;
  return settings;
}

// ---- Axes -------------------------------------------------------------------------------------------

class SimulatedRig final : public AxisRig {
 public:
  SimulatedRig(AxisKind kind, const StageDynamics& dynamics, const AxisLimits& limits)
      : world_(one_joint(kind == AxisKind::kLinear ? JointKind::kPrismatic : JointKind::kRevolute),
               settings_with(dynamics), plate(500), std::nullopt, 17, clock_),
        axis_(make_simulated_drive("stage", world_, 0), kind, limits, clock_) {}

  Axis& axis() override { return axis_; }
  Clock& clock() override { return clock_; }

 private:
  VirtualClock clock_;
  SimulatedWorld world_;
  Axis axis_;
};

const bool linear_registered = register_axis_conformance("SimulatedLinear", [] {
  return std::make_unique<SimulatedRig>(
      AxisKind::kLinear,
      StageDynamics{.travel_min = -5,
                    .travel_max = 305,
                    .max_speed = 200,
                    .max_acceleration = 1000,
                    .homing_speed = 100,
                    .encoder_resolution = 0.01,
                    .repeatability_sigma = 0.005},
      AxisLimits{.lower = 0, .upper = 300, .speed = 120, .acceleration = 600, .in_position = 0.03});
});

const bool rotary_registered = register_axis_conformance("SimulatedRotary", [] {
  return std::make_unique<SimulatedRig>(
      AxisKind::kRotary,
      StageDynamics{.travel_min = -1.1 * kPi,
                    .travel_max = 1.1 * kPi,
                    .max_speed = 1.6,
                    .max_acceleration = 7,
                    .homing_speed = 1,
                    .encoder_resolution = 9e-5,
                    .repeatability_sigma = 3.5e-5},
      AxisLimits{.lower = -kPi, .upper = kPi, .speed = 1, .acceleration = 4, .in_position = 3.5e-4});
});

// ---- Scanner ----------------------------------------------------------------------------------------

/// The plate on a linear stage along the sensor's line of sight: a scene is a position of the stage.
class PlateOnAStage {
 public:
  PlateOnAStage()
      : world_(one_joint(JointKind::kPrismatic), settings(), plate(400), std::nullopt, 1, clock_) {
    world_.stage(0).set_servo(true, clock_.now_s());
    world_.stage(0).start_homing(clock_.now_s());
    clock_.sleep_s(60);
  }

  SimulatedWorld& world() { return world_; }

  Scan show(int scene) {
    const double position_mm = 23.0 * scene;
    world_.stage(0).start_move(position_mm, 100, 1000, clock_.now_s());
    clock_.sleep_s(60);
    const SensorModel& m = world_.sensor();
    Scan truth;
    truth.width = m.width;
    truth.height = m.height;
    for (int row = 0; row < m.height; ++row) {
      for (int column = 0; column < m.width; ++column) {
        const double z = 400 + position_mm;
        const double x =
            z * 2 * std::tan(m.horizontal_fov_rad / 2) * (column - 0.5 * (m.width - 1)) / m.width;
        const double y = z * 2 * std::tan(m.vertical_fov_rad / 2) * (row - 0.5 * (m.height - 1)) / m.height;
        const bool hit = std::abs(x) < kHalfWidth_mm && std::abs(y) < kHalfHeight_mm;
        truth.points.push_back(hit ? Eigen::Vector3d(x, y, z).cast<float>() : invalid_point());
      }
    }
    return truth;
  }

 private:
  static SimulationSettings settings() {
    return settings_with(
        {.travel_max = 200, .max_speed = 200, .max_acceleration = 1000, .homing_speed = 100});
  }

  VirtualClock clock_;
  SimulatedWorld world_;
};

ScannerUnderTest scanner_under_test() {
  auto cell = std::make_shared<PlateOnAStage>();
  ScannerUnderTest out;
  out.scanner = make_simulated_scanner(cell->world());
  out.width = cell->world().sensor().width;
  out.height = cell->world().sensor().height;
  out.show = [cell](int scene) { return cell->show(scene); };
  out.tolerance_mm = 1e-3f;
  out.min_exposure_s = 0.001;
  out.max_exposure_s = 10;
  out.exposure_step_s = 0;
  out.device = cell;
  return out;
}

INSTANTIATE_TEST_SUITE_P(Simulated, ScannerConformance,
                         testing::Values(ScannerFactory{"InProcess", scanner_under_test}),
                         scanner_factory_name);

}  // namespace
}  // namespace gantry
