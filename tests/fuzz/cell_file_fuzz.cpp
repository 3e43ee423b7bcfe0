// CELL.yaml with its simulation section, and PLAN.yaml for the shipped cell. The first byte of an input
// chooses which; the rest is the file.

#include "fuzz.h"
#include "gantry/acquisition/cell.h"
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

}  // namespace

std::vector<std::string> seeds() {
  return {kCell + TemporaryFolder::read(kExamples / "cells/simulated.yaml"),
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
    StrictYaml yaml = StrictYaml::load(path);
    if (yaml.has("simulation")) read_simulation(yaml.map("simulation"), cell.chain);
  });
  return 0;
}
