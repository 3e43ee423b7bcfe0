// CELL.yaml with its simulation section, and PLAN.yaml for the shipped cell. The first byte of an input
// chooses which; the rest is the file.

#include "fuzz.h"
#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/collision_settings.h"
#include "gantry/acquisition/plan.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/sim/world.h"

namespace gantry::fuzz {
namespace {

constexpr char kCell = 'C', kPlan = 'P';
const std::filesystem::path kExamples = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples";

const std::string kPlanOfPoses =
    "name: by poses\nexposure_ms: 20\ndwell_s: 0.5\ninspection: { tolerance_mm: 0.2 }\nviewpoints:\n"
    "  - name: a\n    sensor: { position_mm: [60, -392, 275], look_at_mm: [60, 0, 0] }\n    exposure_ms: 30\n"
    "  - { name: b, joints: { linear_mm: 100, rotation_deg: 0, tilt_deg: 10 } }\n";

/// The shipped cell with a collision and a safety section that use what the shipped ones do not.
std::string other_sections() {
  std::string text = TemporaryFolder::read(kExamples / "cells/simulated.yaml");
  const size_t begin = text.find("collision:"), end = text.find("# Only the simulation");
  return text.replace(begin, end - begin,
                      "collision:\n  clearance_mm: 0\n  bodies:\n"
                      "    - { name: ball, rides_on: part, shapes: [ { kind: sphere, radius_mm: 9 } ] }\n"
                      "    - name: head\n      rides_on: sensor\n      shapes:\n"
                      "        - { kind: cylinder, radius_mm: 3, height_mm: 8, rotation_rpy_deg: [90, 0, 0] }\n"
                      "    - { name: arm, rides_on: tilt, shapes: [ { kind: box, size_mm: [9, 9, 9] } ] }\n"
                      "  may_touch: [ { first: ball, second: part } ]\n"
                      "safety:\n  module: { kind: modbus, host: a, unit: 3, response_timeout_ms: 9 }\n"
                      "  inputs: [ { name: stop, channels: [7], stop_category: 0, release_ms: 0 } ]\n");
}

bool has_mesh_files(const CellCollision& collision) {
  for (const CollisionBodySettings& body : collision.bodies)
    for (const CollisionShape& shape : body.shapes)
      if (shape.kind == CollisionShape::Kind::kMesh) return true;
  return false;
}

/// A short move, checked: whatever the bodies are, it comes to an end.
void check_a_move(const Cell& cell) {
  if (!cell.collision || has_mesh_files(*cell.collision)) return;
  const CollisionModel model = make_collision_model(cell, nullptr, nullptr);
  const std::vector<double> from(cell.axes.size(), 0.0), to(cell.axes.size(), 0.2);
  model.first_on_path(from, to);
}

}  // namespace

std::vector<std::string> seeds() {
  return {kCell + other_sections(),
          kCell + TemporaryFolder::read(kExamples / "cells/simulated.yaml"),
          kCell + TemporaryFolder::read(kExamples / "cells/twin.yaml"),
          kPlan + TemporaryFolder::read(kExamples / "plans/bracket.yaml"), kPlan + kPlanOfPoses};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile file("input.yaml");
  static const Cell shipped = read_cell(fuzz::kExamples / "cells/simulated.yaml");
  if (size == 0) return 0;
  const auto& path = file.write(fuzz::text_of(data + 1, size - 1));
  fuzz::value_or_input_error([&] {
    if (data[0] == fuzz::kPlan) {
      for (const Viewpoint& view : read_plan(path, shipped).viewpoints)
        shipped.chain.uncertain_part_from_sensor(view.q);
      return;
    }
    const Cell cell = read_cell(path);
    const std::vector<double> zero(cell.axes.size());
    if (!cell.chain.uncertain_part_from_sensor(zero).mean.matrix().allFinite())
      throw std::logic_error("a chain that leads nowhere");
    fuzz::check_a_move(cell);
    StrictYaml yaml = StrictYaml::load(path);
    if (yaml.has("simulation")) read_simulation(yaml.map("simulation"), cell.chain);
  });
  return 0;
}
