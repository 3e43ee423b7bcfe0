#include "gantry/acquisition/cell.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/kinematics/chain_file.h"

namespace gantry {
namespace {

DriveSettings read_drive(StrictYaml yaml) {
  DriveSettings drive;
  drive.profile = yaml.choice("profile", {"iai_robo_cylinder", "oriental_motor_az", "simulated"});
  if (drive.profile != "simulated") {
    drive.host = yaml.text("host");
    drive.port = yaml.integer_or("port", 502, 1, 65535);
    drive.unit = yaml.integer("unit", 1, 247);
  }
  if (drive.profile == "oriental_motor_az")
    drive.steps_per_revolution = yaml.number("steps_per_revolution", {100, 1e8});
  yaml.finish();
  return drive;
}

AxisSettings read_axis(StrictYaml yaml, const Joint& joint) {
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
  axis.settle_s = motion.number_or("settle_s", axis.settle_s, {0, 60});
  motion.finish();
  axis.drive = read_drive(yaml.map("drive"));
  if (axis.drive.profile == "iai_robo_cylinder" && !linear)
    yaml.fail("drive", "iai_robo_cylinder is a linear drive, but joint '" + joint.name + "' is revolute");
  if (axis.drive.profile == "oriental_motor_az" && linear)
    yaml.fail("drive",
              "oriental_motor_az drives revolute joints here, but joint '" + joint.name + "' is prismatic");
  yaml.finish();
  return axis;
}

}  // namespace

Cell read_cell(const std::filesystem::path& path) {
  StrictYaml yaml = StrictYaml::load(path);
  Cell cell;
  cell.file = path;
  cell.name = yaml.text("name");
  cell.calibration_id = yaml.text("calibration_id");

  std::set<std::string> names;
  for (StrictYaml& axis : yaml.maps("axes")) {
    const std::string name = axis.text("name");
    if (!names.insert(name).second) axis.fail("name", "two axes are called '" + name + "'");
    cell.chain.joints.push_back(read_joint(axis.map("joint"), name));
    cell.axes.push_back(read_axis(axis, cell.chain.joints.back()));
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

  StrictYaml homing = yaml.map("homing");
  for (StrictYaml& step : homing.maps("order")) {
    const std::string axis = step.text("axis");
    if (!names.contains(axis)) step.fail("axis", "there is no axis '" + axis + "'");
    if (std::count(cell.homing_order.begin(), cell.homing_order.end(), axis))
      step.fail("axis", "axis '" + axis + "' is homed twice");
    cell.homing_order.push_back(axis);
    step.finish();
  }
  if (cell.homing_order.size() != cell.axes.size())
    homing.fail("order", "every axis must be homed: " + std::to_string(cell.axes.size()) + " axes, " +
                             std::to_string(cell.homing_order.size()) + " in this list");
  homing.finish();
  if (auto collision = yaml.map_if_present("collision"))
    cell.collision = read_collision(std::move(*collision), cell.chain);
  if (auto safety = yaml.map_if_present("safety")) cell.safety = read_safety(*safety);
  yaml.leave_to_others("simulation");
  yaml.finish();
  return cell;
}

}  // namespace gantry
