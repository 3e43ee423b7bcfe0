#include "gantry/sim/world.h"

#include <random>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// Draws a true chain around the nominal one, with the sigmas that the nominal chain states. Written
/// on the joint's geometry, not on twists, so that it does not repeat the covariance's own derivation.
Chain draw_truth(const Chain& nominal, std::mt19937_64& random) {
  std::normal_distribution<double> gauss;
  Chain truth = nominal;
  for (Joint& joint : truth.joints) {
    const Eigen::Vector3d a = joint.direction.unitOrthogonal(), b = joint.direction.cross(a);
    const double tilt_a = gauss(random), tilt_b = gauss(random), shift_a = gauss(random),
                 shift_b = gauss(random);
    joint.point_mm += joint.point_sigma_mm * (shift_a * a + shift_b * b);
    joint.direction = (joint.direction + joint.direction_sigma_rad * (tilt_a * a + tilt_b * b)).normalized();
  }
  Eigen::Vector3d rotation, shift;
  for (int k = 0; k < 3; ++k) {
    rotation[k] = nominal.sensor_rotation_sigma_rad * gauss(random);
    shift[k] = nominal.sensor_position_sigma_mm * gauss(random);
  }
  truth.base_from_sensor.linear() = nominal.base_from_sensor.linear() * rotation_exp(rotation);
  truth.base_from_sensor.translation() += shift;
  return truth;
}

StageDynamics read_stage(StrictYaml yaml, JointKind kind) {
  const bool linear = kind == JointKind::kPrismatic;
  const auto value = [&](const std::string& key, double min) {
    return linear ? yaml.number(key, {min, 1e6}) : yaml.angle_deg(key, {min, 1e6});
  };
  constexpr double kSlowest = 1e-3;  // what never moves would never arrive
  const std::string unit = linear ? "_mm" : "_deg";
  StageDynamics stage;
  const Eigen::Vector2d travel = yaml.interval("travel" + unit);
  const double scale = linear ? 1.0 : std::acos(-1.0) / 180.0;
  stage.travel_min = travel[0] * scale;
  stage.travel_max = travel[1] * scale;
  stage.max_speed = value("max_speed" + unit + "_s", kSlowest);
  stage.max_acceleration = value("max_acceleration" + unit + "_s2", kSlowest);
  stage.homing_speed = value("homing_speed" + unit + "_s", kSlowest);
  stage.encoder_resolution = value("encoder_resolution" + unit, 0);
  stage.repeatability_sigma = value("repeatability" + unit, 0);
  stage.settling_time_s = yaml.number_or("settling_time_s", stage.settling_time_s, {0, 10});
  const auto optional = [&](StrictYaml& map, const std::string& key, double fallback, double min) {
    return map.has(key) ? map.number(key, {min, 1e6}) * scale : fallback;
  };
  if (yaml.has("limit_switches" + unit)) {
    const Eigen::Vector2d limits = yaml.interval("limit_switches" + unit);
    if (limits[0] * scale <= stage.travel_min || limits[1] * scale >= stage.travel_max)
      yaml.fail("limit_switches" + unit, "must lie within the travel");
    stage.lower_limit = limits[0] * scale;
    stage.upper_limit = limits[1] * scale;
  }
  stage.following_lag_s = yaml.number_or("following_lag_ms", 0, {0, 1000}) / 1e3;
  stage.backlash = optional(yaml, "backlash" + unit, 0, 0);
  if (auto homing = yaml.map_if_present("homing")) {
    const std::string method = homing->choice("method", {"stored", "switch", "switch_and_index"});
    if (method != "stored") {
      stage.homing = method == "switch" ? HomingMethod::kSwitch : HomingMethod::kSwitchAndIndex;
      stage.search_direction = homing->choice("search", {"down", "up"}) == "down" ? -1 : 1;
      stage.creep_speed = optional(*homing, "creep_speed" + unit + "_s", 0.1 * stage.homing_speed, kSlowest);
      if (stage.homing == HomingMethod::kSwitch)
        stage.back_off = homing->number("back_off" + unit, {1e-6, 1e6}) * scale;
      else
        stage.index_pitch = homing->number("index_pitch" + unit, {1e-6, 1e6}) * scale;
    }
    homing->finish();
  }
  yaml.finish();
  return stage;
}

SensorModel read_sensor(StrictYaml yaml) {
  SensorModel m;
  constexpr double kDeg = 3.14159265358979323846 / 180.0;
  m.width = yaml.integer_or("width_px", m.width, 16, 8192);
  m.height = yaml.integer_or("height_px", m.height, 16, 8192);
  m.horizontal_fov_rad = yaml.angle_deg_or("horizontal_fov_deg", m.horizontal_fov_rad / kDeg, {1, 120});
  m.vertical_fov_rad = yaml.angle_deg_or("vertical_fov_deg", m.vertical_fov_rad / kDeg, {1, 120});
  m.near_mm = yaml.number_or("near_mm", m.near_mm, {1, 1e5});
  m.far_mm = yaml.number_or("far_mm", m.far_mm, {1, 1e5});
  if (m.near_mm >= m.far_mm) yaml.fail("near_mm", "must be smaller than far_mm");
  m.projector_offset_mm = yaml.number_or("projector_offset_mm", m.projector_offset_mm, {-1000, 1000});
  m.noise_mm = yaml.number_or("noise_mm", m.noise_mm, {0, 10});
  m.distortion_mm = yaml.number_or("distortion_mm", m.distortion_mm, {0, 10});
  m.max_incidence_rad = yaml.angle_deg_or("max_incidence_deg", m.max_incidence_rad / kDeg, {61, 89.9});
  m.mixed_pixel_probability = yaml.number_or("mixed_pixel_probability", m.mixed_pixel_probability, {0, 1});
  m.mixed_pixel_step_mm = yaml.number_or("mixed_pixel_step_mm", m.mixed_pixel_step_mm, {0.01, 1000});
  m.dropout_probability = yaml.number_or("dropout_probability", m.dropout_probability, {0, 1});
  yaml.finish();
  return m;
}

}  // namespace

SimulationSettings read_simulation(StrictYaml simulation, const Chain& chain) {
  SimulationSettings settings;
  settings.sensor = read_sensor(simulation.map("sensor"));
  std::vector<StrictYaml> stages = simulation.maps("stages");
  if (stages.size() != chain.joints.size())
    simulation.fail("stages", "expected one entry for each of the " + std::to_string(chain.joints.size()) +
                                  " axes, found " + std::to_string(stages.size()));
  for (size_t i = 0; i < stages.size(); ++i)
    settings.stages.push_back(read_stage(std::move(stages[i]), chain.joints[i].kind));
  settings.placement_sigma_mm =
      simulation.number_or("placement_sigma_mm", settings.placement_sigma_mm, {0, 10});
  settings.placement_sigma_rad = simulation.angle_deg_or("placement_sigma_deg", 0.2, {0, 10});
  settings.part = simulation.path("part");
  if (simulation.has("holder")) settings.holder = simulation.path("holder");
  simulation.leave_to_others("serial");  // the twin's lines
  simulation.finish();
  return settings;
}

SimulatedWorld::SimulatedWorld(const Chain& nominal, const SimulationSettings& settings,
                               const TriangleMesh& part, const std::optional<TriangleMesh>& holder,
                               uint64_t seed, Clock& clock)
    : settings_(settings), seed_(seed), clock_(clock) {
  if (settings.stages.size() != nominal.joints.size())
    throw InputError("simulation: one stage is needed for each joint of the chain");
  std::mt19937_64 random(seed);
  truth_ = draw_truth(nominal, random);
  std::normal_distribution<double> gauss;
  Vector6d placement;
  for (int k = 0; k < 6; ++k)
    placement[k] = gauss(random) * (k < 3 ? settings.placement_sigma_rad : settings.placement_sigma_mm);
  part_from_cad_ = pose_exp(placement);
  // The holder is where the stage is; only the part can be put down imprecisely.
  TriangleMesh scene = transformed(part, part_from_cad_);
  if (holder) scene = merged(scene, *holder);
  scene_ = std::make_unique<RayScene>(std::move(scene));
  for (const StageDynamics& dynamics : settings.stages)
    stages_.push_back(std::make_unique<SimulatedStage>(dynamics, random()));
}

Pose SimulatedWorld::true_part_from_sensor(double now_s) const {
  std::vector<double> q;
  for (const auto& stage : stages_) q.push_back(stage->observe(now_s).true_position);
  return truth_.part_from_sensor(q);
}

Scan SimulatedWorld::expose(double exposure_s) {
  std::lock_guard lock(exposing_);
  const Pose begin = true_part_from_sensor(clock_.now_s());
  clock_.sleep_s(exposure_s);
  const Pose end = true_part_from_sensor(clock_.now_s());
  return trace_scan(settings_.sensor, *scene_, begin, end, seed_, scan_number_++);
}

}  // namespace gantry
