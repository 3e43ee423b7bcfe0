// Every shipped drive profile, against the twin's drive of that name, over the wire.
#include "hal/twin_rig.h"

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStepsPerRadian = 36'000 / (2 * kPi);  // 0.01 degrees a step.

constexpr StageDynamics kLinearStage{.travel_min = -5,
                                     .travel_max = 305,
                                     .max_speed = 200,
                                     .max_acceleration = 2000,
                                     .homing_speed = 20,
                                     .encoder_resolution = 0.001,
                                     .repeatability_sigma = 0.005};
constexpr AxisLimits kLinearLimits{
    .lower = 0, .upper = 300, .speed = 100, .acceleration = 1000, .in_position = 0.06};
constexpr StageDynamics kRotaryStage{.travel_min = -1.1 * kPi,
                                     .travel_max = 1.1 * kPi,
                                     .max_speed = 2,
                                     .max_acceleration = 10,
                                     .homing_speed = 0.5,
                                     .encoder_resolution = 1e-5,
                                     .repeatability_sigma = 5e-5};
constexpr AxisLimits kRotaryLimits{
    .lower = -kPi, .upper = kPi, .speed = 1, .acceleration = 5, .in_position = 0.002};

const bool registered = [] {
  const auto linear = [](const std::string& name, const std::string& profile, double counts) {
    register_axis_conformance(name, [=] {
      return std::make_unique<TwinRig>(profile, AxisKind::kLinear, counts, kLinearStage, kLinearLimits);
    });
  };
  const auto rotary = [](const std::string& name, const std::string& profile, double counts) {
    register_axis_conformance(name, [=] {
      return std::make_unique<TwinRig>(profile, AxisKind::kRotary, counts, kRotaryStage, kRotaryLimits);
    });
  };
  linear("IaiRoboCylinder", "iai_robo_cylinder", 0);
  rotary("OrientalMotorAz", "oriental_motor_az", kStepsPerRadian);
  linear("OrientalMotorAzLinear", "oriental_motor_az", 500);
  // One revolution of the motor is 5 mm; behind a gear of 1:36, a 36th of a turn.
  linear("LeadshineCs2rs", "leadshine_cs2rs", 2000);
  rotary("LeadshineCs2rsRotary", "leadshine_cs2rs", 360'000 / (2 * kPi));
  linear("KincoFd", "kinco_fd", 65536 / 5.0);
  rotary("KincoFdRotary", "kinco_fd", 36 * 65536 / (2 * kPi));
  return true;
}();

}  // namespace
}  // namespace gantry
