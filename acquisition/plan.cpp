#include "gantry/acquisition/plan.h"

#include <cmath>
#include <cstdio>
#include <numbers>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/kinematics/inverse.h"

namespace gantry {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

/// `joints: {linear_mm: 100, rotation_deg: 30, tilt_deg: -20}`
std::vector<double> read_joints(StrictYaml yaml, const Cell& cell) {
  std::vector<double> q;
  for (const AxisSettings& axis : cell.axes) {
    const bool linear = axis.kind == AxisKind::kLinear;
    const std::string key = axis.name + (linear ? "_mm" : "_deg");
    const double value = linear ? yaml.number(key) : yaml.angle_deg(key);
    if (!(value >= axis.lowest_target() && value <= axis.highest_target())) {
      const double scale = linear ? 1.0 : kDegPerRad;
      char text[160];
      std::snprintf(text, sizeof text, "%.3f lies outside the soft limits of axis %s%s, %.3f to %.3f %s",
                    value * scale, axis.name.c_str(),
                    axis.approach == Approach::kAny ? "" : " less the way of approach",
                    axis.lowest_target() * scale, axis.highest_target() * scale, linear ? "mm" : "deg");
      yaml.fail(key, text);
    }
    q.push_back(value);
  }
  yaml.finish();
  return q;
}

/// `sensor: {position_mm: [...], look_at_mm: [...], position_tolerance_mm: 1, direction_tolerance_deg: 1}`
std::vector<double> read_sensor_pose(StrictYaml yaml, const Cell& cell) {
  ViewTarget target;
  target.sensor_position_mm = yaml.vector3("position_mm");
  const Eigen::Vector3d line = yaml.vector3("look_at_mm") - target.sensor_position_mm;
  if (line.norm() < 1) yaml.fail("look_at_mm", "must not be where the sensor is");
  target.viewing_direction = line.normalized();
  const double position_tolerance = yaml.number_or("position_tolerance_mm", 1.0, {0.001, 1000});
  const double direction_tolerance = yaml.angle_deg_or("direction_tolerance_deg", 1.0, {0.001, 90});
  yaml.finish();
  std::vector<double> lower, upper;
  for (const AxisSettings& axis : cell.axes) {
    lower.push_back(axis.lowest_target());
    upper.push_back(axis.highest_target());
  }
  const InverseResult found = nearest_view(cell.chain, target, lower, upper);
  if (found.position_error_mm > position_tolerance || found.direction_error_rad > direction_tolerance) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "no joint positions within the soft limits reach this view; the nearest is %.1f mm and %.1f deg off "
        "(allowed: %.1f mm, %.1f deg)",
        found.position_error_mm, found.direction_error_rad * kDegPerRad, position_tolerance,
        direction_tolerance * kDegPerRad);
    yaml.fail("position_mm", text);
  }
  return found.q;
}

}  // namespace

Plan read_plan(const std::filesystem::path& path, const Cell& cell) {
  StrictYaml yaml = StrictYaml::load(path);
  Plan plan;
  plan.file = path;
  plan.name = yaml.text("name");
  StrictYaml inspection = yaml.map("inspection");
  plan.tolerance_mm = inspection.number("tolerance_mm", {1e-4, 100});
  plan.crop_margin_mm = inspection.number_or("crop_margin_mm", plan.crop_margin_mm, {0, 1000});
  inspection.finish();
  const double exposure_ms = yaml.number("exposure_ms", {1, 10000});
  const double dwell_s = yaml.number_or("dwell_s", 0, {0, 600});
  std::set<std::string> names;
  for (StrictYaml& entry : yaml.maps("viewpoints")) {
    Viewpoint view;
    view.name = entry.text("name");
    if (!names.insert(view.name).second) entry.fail("name", "two viewpoints are called '" + view.name + "'");
    if (entry.has("joints") == entry.has("sensor"))
      entry.fail("name", "viewpoint '" + view.name + "' needs either 'joints' or 'sensor'");
    view.q = entry.has("joints") ? read_joints(entry.map("joints"), cell)
                                 : read_sensor_pose(entry.map("sensor"), cell);
    view.exposure_s = entry.number_or("exposure_ms", exposure_ms, {1, 10000}) / 1000;
    view.dwell_s = entry.number_or("dwell_s", dwell_s, {0, 600});
    entry.finish();
    plan.viewpoints.push_back(std::move(view));
  }
  yaml.finish();
  return plan;
}

}  // namespace gantry
