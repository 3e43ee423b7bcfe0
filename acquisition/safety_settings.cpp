#include "gantry/acquisition/safety_settings.h"

#include <algorithm>

#include <cmath>

namespace gantry {
namespace {

SafetyModuleSettings read_module(StrictYaml yaml) {
  SafetyModuleSettings module;
  module.kind = yaml.choice("kind", {"modbus", "simulated"});
  if (module.kind == "modbus") {
    module.host = yaml.text("host");
    module.port = yaml.integer_or("port", 502, 1, 65535);
    module.unit = yaml.integer("unit", 1, 247);
    module.response_timeout_s =
        yaml.number_or("response_timeout_ms", module.response_timeout_s * 1e3, {1, 5000}) / 1e3;
  }
  yaml.finish();
  return module;
}

SafetyInputSettings read_input(StrictYaml yaml) {
  SafetyInputSettings input;
  input.name = yaml.text("name");
  for (const double channel : yaml.numbers("channels")) {
    if (!(channel >= 0 && channel <= 0xFFFF) || channel != std::floor(channel))
      yaml.fail("channels", "expected addresses of discrete inputs, whole numbers from 0 to 65535");
    input.channels.push_back(static_cast<int>(channel));
  }
  if (input.channels.size() != 1 && input.channels.size() != 2)
    yaml.fail("channels", "expected one or two channels, found " + std::to_string(input.channels.size()));
  input.stop = yaml.integer("stop_category", 0, 1) == 0 ? StopCategory::kCategory0 : StopCategory::kCategory1;
  if (input.channels.size() == 2)
    input.discrepancy_s = yaml.number_or("discrepancy_ms", input.discrepancy_s * 1e3, {1, 10000}) / 1e3;
  else if (yaml.has("discrepancy_ms"))
    yaml.fail("discrepancy_ms",
              "one channel cannot disagree with itself; give two channels or leave this out");
  input.release_s = yaml.number_or("release_ms", input.release_s * 1e3, {0, 10000}) / 1e3;
  yaml.finish();
  return input;
}

}  // namespace

double CellSafety::settle_s() const {
  double longest_s = 0;
  for (const SafetyInputSettings& input : chain.inputs) longest_s = std::max(longest_s, input.release_s);
  return longest_s + 4 * poll_s + module.response_timeout_s;
}

CellSafety read_safety(StrictYaml yaml) {
  CellSafety safety;
  safety.module = read_module(yaml.map("module"));
  safety.poll_s = yaml.number_or("poll_ms", safety.poll_s * 1e3, {1, 1000}) / 1e3;
  safety.chain.max_age_s = yaml.number_or("max_age_ms", safety.chain.max_age_s * 1e3, {2, 5000}) / 1e3;
  if (safety.chain.max_age_s < 2 * safety.poll_s)
    yaml.fail("max_age_ms", "must be at least twice poll_ms: one late reading would stop the cell");
  if (safety.module.kind == "modbus" && safety.module.response_timeout_s >= safety.chain.max_age_s)
    yaml.fail("max_age_ms", "must be larger than the module's response_timeout_ms");
  safety.chain.ramp_limit_s = yaml.number_or("ramp_limit_s", safety.chain.ramp_limit_s, {0, 60});
  for (StrictYaml& input : yaml.maps("inputs")) safety.chain.inputs.push_back(read_input(std::move(input)));
  yaml.finish();
  try {
    SafetyChain validated(safety.chain);
  } catch (const InputError& e) {
    yaml.fail("inputs", e.what());
  }
  return safety;
}

}  // namespace gantry
