#include "gantry/acquisition/cell.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/kinematics/chain_file.h"

namespace gantry {
namespace {

AxisSettings read_axis(StrictYaml yaml, const Joint& joint, const std::vector<BusSettings>& buses) {
  AxisSettings axis;
  axis.name = joint.name;
  const bool linear = joint.kind == JointKind::kPrismatic;
  axis.kind = linear ? AxisKind::kLinear : AxisKind::kRotary;
  StrictYaml motion = yaml.map("motion");
  const double scale = linear ? 1.0 : std::numbers::pi / 180.0;
  const std::string unit = linear ? "_mm" : "_deg";
  const Eigen::Vector2d soft = motion.interval("soft_limits" + unit);
  axis.limits.lower = soft[0] * scale;
  axis.limits.upper = soft[1] * scale;
  axis.limits.speed = motion.number("speed" + unit + "_s", {1e-3, 1e4}) * scale;
  axis.limits.acceleration = motion.number("acceleration" + unit + "_s2", {1e-3, 1e6}) * scale;
  axis.limits.in_position = motion.number("in_position" + unit, {1e-6, 10}) * scale;
  axis.limits.homing_timeout_s = motion.number_or("homing_timeout_s", 60, {0.1, 3600});
  const auto optional = [&](const std::string& key, double fallback, double max) {
    return motion.number_or(key, fallback / scale, {0, max}) * scale;
  };
  const double fastest = axis.limits.speed / scale;
  axis.limits.jog_speed = optional("jog_speed" + unit + "_s", 0, fastest);
  axis.limits.unhomed_jog_speed = optional("unhomed_jog_speed" + unit + "_s", 0, fastest);
  axis.limits.following_error = optional("following_error" + unit, 0, 1e4);
  axis.limits.following_error_at_rest = optional(
      "following_error_at_rest" + unit, axis.limits.following_error / 2, axis.limits.following_error / scale);
  axis.limits.following_error_time_s = motion.number_or("following_error_time_s", 0.1, {0, 60});
  if (motion.has("approach")) {
    const std::string side = motion.choice("approach", {"any", "from_below", "from_above"});
    axis.approach = side == "from_below"   ? Approach::kFromBelow
                    : side == "from_above" ? Approach::kFromAbove
                                           : Approach::kAny;
  }
  if (axis.approach != Approach::kAny) {
    axis.approach_distance = motion.number("approach_distance" + unit, {1e-6, 1e3}) * scale;
    if (axis.lowest_target() >= axis.highest_target())
      motion.fail("approach_distance" + unit, "leaves no target between the soft limits");
  }
  axis.settle_s = motion.number_or("settle_s", axis.settle_s, {0, 60});
  motion.finish();
  axis.drive = read_drive(yaml.map("drive"), axis.kind, buses);
  yaml.finish();
  return axis;
}

/// `axis: tilt` and, as an option, `offset_deg: 1.5`: where the axis is when the drive has homed.
std::string read_homing_step(StrictYaml step, Cell& cell) {
  const std::string name = step.text("axis");
  const auto axis =
      std::find_if(cell.axes.begin(), cell.axes.end(), [&](const AxisSettings& a) { return a.name == name; });
  if (axis == cell.axes.end()) step.fail("axis", "there is no axis '" + name + "'");
  for (const auto& group : cell.homing_order)
    if (std::count(group.begin(), group.end(), name)) step.fail("axis", "axis '" + name + "' is homed twice");
  axis->limits.position_at_home = axis->kind == AxisKind::kLinear
                                      ? step.number_or("offset_mm", 0, {-1e5, 1e5})
                                      : step.angle_deg_or("offset_deg", 0, {-1e5, 1e5});
  step.finish();
  return name;
}

void read_homing(StrictYaml homing, Cell& cell) {
  size_t homed = 0;
  for (StrictYaml& step : homing.maps("order")) {
    // The group is known to the cell before it is complete, so that a name that occurs twice is found.
    cell.homing_order.emplace_back();
    if (!step.has("together")) {
      const std::string name = read_homing_step(step, cell);
      cell.homing_order.back().push_back(name);
    } else {
      for (StrictYaml& one : step.maps("together", 2)) {
        const std::string name = read_homing_step(one, cell);
        cell.homing_order.back().push_back(name);
      }
      step.finish();
    }
    homed += cell.homing_order.back().size();
  }
  if (homed != cell.axes.size())
    homing.fail("order", "every axis must be homed: " + std::to_string(cell.axes.size()) + " axes, " +
                             std::to_string(homed) + " in this list");
  homing.finish();
}

void read_supervisor(StrictYaml yaml, Cell& cell) {
  SupervisorSettings& s = cell.supervisor;
  s.period_s = yaml.number_or("period_ms", s.period_s * 1e3, {1, 100}) / 1e3;
  s.stall_limit_s = yaml.number_or("stall_limit_s", s.stall_limit_s, {0.01, 10});
  s.dead_man_s = yaml.number_or("dead_man_s", s.dead_man_s, {0.05, 2});
  if (s.stall_limit_s <= 2 * s.period_s) yaml.fail("stall_limit_s", "must be longer than two periods");
  if (s.dead_man_s <= 2 * s.period_s) yaml.fail("dead_man_s", "must be longer than two periods");
  const double data_limit_s = yaml.number_or("data_limit_s", AxisLimits{}.data_limit_s, {0.02, 10});
  if (data_limit_s <= 2 * s.period_s) yaml.fail("data_limit_s", "must be longer than two periods");
  for (AxisSettings& axis : cell.axes) axis.limits.data_limit_s = data_limit_s;
  cell.drive_timeout_s = yaml.number_or("drive_timeout_s", 0, {0, 60});
  yaml.finish();
}

std::chrono::sys_days read_date(StrictYaml& yaml, const std::string& key) {
  const std::string text = yaml.text(key);
  int year = 0;
  unsigned month = 0, day = 0;
  int read = 0;
  const bool shaped = text.size() == 10 &&
                      std::sscanf(text.c_str(), "%4d-%2u-%2u%n", &year, &month, &day, &read) == 3 &&
                      read == 10;
  const std::chrono::year_month_day date{std::chrono::year(year), std::chrono::month(month),
                                         std::chrono::day(day)};
  if (!shaped || !date.ok()) yaml.fail(key, "'" + text + "' is no date; expected one like 2026-01-31");
  return date;
}

}  // namespace

double AxisSettings::lowest_target() const {
  return limits.lower + (approach == Approach::kFromBelow ? approach_distance : 0);
}

double AxisSettings::highest_target() const {
  return limits.upper - (approach == Approach::kFromAbove ? approach_distance : 0);
}

Cell read_cell(const std::filesystem::path& path) {
  StrictYaml yaml = StrictYaml::load(path);
  Cell cell;
  cell.file = path;
  cell.name = yaml.text("name");
  cell.calibration_id = yaml.text("calibration_id");
  if (yaml.has("calibrated_on")) cell.calibrated_on = read_date(yaml, "calibrated_on");

  cell.buses = read_buses(yaml);
  std::set<std::string> names;
  std::set<std::pair<std::string, int>> units;
  for (StrictYaml& axis : yaml.maps("axes")) {
    const std::string name = axis.text("name");
    if (!names.insert(name).second) axis.fail("name", "two axes are called '" + name + "'");
    cell.chain.joints.push_back(read_joint(axis.map("joint"), name));
    cell.axes.push_back(read_axis(axis, cell.chain.joints.back(), cell.buses));
    const DriveSettings& drive = cell.axes.back().drive;
    if (drive.profile != "simulated" && !units.emplace(drive.bus_key(), drive.unit).second)
      axis.fail("drive", "another axis has unit " + std::to_string(drive.unit) + " at " + drive.bus_key());
  }

  StrictYaml sensor = yaml.map("sensor");
  cell.chain.base_from_sensor = read_pose(sensor);
  cell.chain.sensor_position_sigma_mm = sensor.number("position_sigma_mm", {0, 100});
  cell.chain.sensor_rotation_sigma_rad = sensor.angle_deg("rotation_sigma_deg", {0, 45});
  cell.chain.sensor_systematic_sigma_mm = sensor.number_or("systematic_sigma_mm", 0.02, {0, 10});
  StrictYaml scanner = sensor.map("scanner");
  cell.scanner.kind = scanner.choice("kind", {"genicam3d", "simulated"});
  if (cell.scanner.kind == "genicam3d") cell.scanner.address = scanner.text("address");
  scanner.finish();
  sensor.finish();

  StrictYaml part = yaml.map("part");
  cell.chain.base_from_part_at_zero = read_pose(part);
  part.finish();
  if (yaml.has("fixture")) cell.fixture = yaml.path("fixture");

  read_homing(yaml.map("homing"), cell);
  if (yaml.has("supervisor")) read_supervisor(yaml.map("supervisor"), cell);
  if (auto collision = yaml.map_if_present("collision"))
    cell.collision = read_collision(std::move(*collision), cell.chain);
  if (auto safety = yaml.map_if_present("safety")) cell.safety = read_safety(*safety);
  yaml.leave_to_others("simulation");
  yaml.finish();
  return cell;
}

}  // namespace gantry
