#include "simulated_inspection.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gantry/foundation/clock.h"
#include "gantry/foundation/error.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/fusion/fusion.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/spatial_order.h"
#include "gantry/sim/world.h"

namespace gantry::bench {
namespace {

constexpr size_t kPoints = 4000;
constexpr double kLongEnough_s = 60;  ///< For any stage to arrive and settle.
constexpr float kReach_mm = 3;
constexpr float kEdge_mm = 1;
constexpr float kFacing = 0.5f;

/// Drives the stages through the plan; the scans as the cell would tag them.
std::vector<TaggedScan> scan_part(const Cell& cell, const Chain& chain, const Plan& plan,
                                  SimulatedWorld& world, Clock& clock) {
  for (size_t axis = 0; axis < world.axis_count(); ++axis) {
    world.stage(axis).set_servo(true, clock.now_s());
    world.stage(axis).start_homing(clock.now_s());
  }
  clock.sleep_s(kLongEnough_s);
  std::vector<TaggedScan> scans;
  for (const Viewpoint& view : plan.viewpoints) {
    for (size_t axis = 0; axis < world.axis_count(); ++axis)
      world.stage(axis).start_move(view.q[axis], cell.axes[axis].limits.speed,
                                   cell.axes[axis].limits.acceleration, clock.now_s());
    clock.sleep_s(kLongEnough_s);
    std::vector<double> q;
    for (size_t axis = 0; axis < world.axis_count(); ++axis)
      q.push_back(world.stage(axis).observe(clock.now_s()).encoder_position);
    TaggedScan scan;
    scan.name = view.name;
    scan.scan = world.expose(view.exposure_s);
    scan.part_from_sensor = chain.uncertain_part_from_sensor(q);
    scan.part_from_sensor.calibration_id = cell.calibration_id;
    scans.push_back(std::move(scan));
  }
  return scans;
}

/// Whether the mesh is smooth for 1 mm around a point of it.
bool smooth_around(const SignedDistance& part, const SignedDistance::Value& at, const Eigen::Vector3f& face) {
  const Eigen::Vector3f u = face.unitOrthogonal(), v = face.cross(u);
  for (int k = 0; k < 8; ++k) {
    const auto angle = static_cast<float>(k * std::numbers::pi / 4);
    const Eigen::Vector3f beside = at.closest + kEdge_mm * (std::cos(angle) * u + std::sin(angle) * v);
    const auto value = part(beside, face, 0.7f, kEdge_mm);
    if (!value || std::abs(value->distance) > 0.3f * kEdge_mm) return false;
  }
  return true;
}

std::vector<Judged> judged_points(const InspectionResult& result, const SignedDistance& part,
                                  const SignedDistance& cad) {
  std::vector<Judged> points;
  const size_t every = std::max<size_t>(1, result.cloud.size() / kPoints);
  const std::vector<uint32_t> order = morton_order(result.cloud.points);
  for (size_t k = 0; k < order.size(); k += every) {
    const size_t i = order[k];
    if (result.point_class[i] != PointClass::kJudged) continue;
    const Eigen::Vector3f& normal = result.cloud.normals[i];
    const auto on_part = part(result.cloud.points[i], normal, kFacing, kReach_mm);
    if (!on_part) continue;
    const Eigen::Vector3f face = part.mesh().normal(static_cast<size_t>(on_part->triangle));
    const auto truth = cad(on_part->closest, face, kFacing, kReach_mm);
    if (!truth) continue;
    points.push_back({result.deviation_mm[i], truth->distance, result.uncertainty_mm[i],
                      smooth_around(part, *on_part, face)});
  }
  return points;
}

double largest_deviation(const TriangleMesh& part, const SignedDistance& cad) {
  double largest = 0;
  for (const Eigen::Vector3f& v : part.vertices)
    if (const auto value = cad(v, kReach_mm)) largest = std::max<double>(largest, std::abs(value->distance));
  return largest;
}

}  // namespace

SimulatedInspection::SimulatedInspection(const std::filesystem::path& cell, const std::filesystem::path& plan)
    : cell_(read_cell(cell)),
      plan_(read_plan(plan, cell_)),
      fixture_(read_mesh(cell_.fixture)),
      cad_(make_bracket()) {}

Outcome SimulatedInspection::run(const Trial& trial) const {
  StrictYaml yaml = StrictYaml::load(cell_.file);
  SimulationSettings settings = read_simulation(yaml.map("simulation"), cell_.chain);
  settings.sensor.height = settings.sensor.height * trial.columns / settings.sensor.width;
  settings.sensor.width = trial.columns;
  settings.sensor.distortion_mm = trial.distortion_mm;
  settings.sensor.distortion_seed = trial.seed;
  const TriangleMesh part = make_bracket(trial.defects);
  VirtualClock clock;
  SimulatedWorld world(cell_.chain, settings, part, make_holder(), trial.seed, clock);

  FusionOptions fusion_options;
  const Eigen::AlignedBox3f bounds = cad_.mesh().bounds();
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(plan_.crop_margin_mm);
  fusion_options.preprocess.crop_part_mm =
      Eigen::AlignedBox3d(bounds.min().cast<double>() - margin, bounds.max().cast<double>() + margin);
  Chain told = cell_.chain;
  told.sensor_systematic_sigma_mm = trial.systematic_mm;
  Fusion fusion(fusion_options);
  for (const TaggedScan& scan : scan_part(cell_, told, plan_, world, clock)) fusion.add(scan);
  const FusionResult fused = fusion.finish();
  Outcome outcome;
  if (!fused.trusted) {
    outcome.trouble = fused.reason;
    return outcome;
  }
  InspectionOptions options;
  options.tolerance_mm = trial.tolerance_mm;
  options.systematic_sigma_mm = trial.systematic_mm;
  options.fixture = fixture_;
  options.symmetry_tolerance_mm = 0;
  outcome.inspection = inspect(fused.merged, cad_, options);
  const SignedDistance true_part(part);
  outcome.points = judged_points(outcome.inspection, true_part, cad_);
  outcome.largest_truth_mm = largest_deviation(part, cad_);
  return outcome;
}

}  // namespace gantry::bench
