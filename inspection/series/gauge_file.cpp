#include "gantry/foundation/strict_yaml.h"
#include "gantry/inspection/gauge.h"

namespace gantry {

GaugeStudy read_gauge_study(const std::filesystem::path& file) {
  StrictYaml yaml = StrictYaml::load(file);
  GaugeStudy study;
  study.name = yaml.text_or("name", file.stem().string());
  for (StrictYaml& entry : yaml.maps("runs", 2)) {
    GaugeTrial trial;
    trial.run = entry.path("run");
    trial.part = entry.text("part");
    trial.appraiser = entry.text_or("appraiser", "");
    for (const GaugeTrial& other : study.trials)
      if (other.run == trial.run) entry.fail("run", "this run is listed twice");
    if (!study.trials.empty() && trial.appraiser.empty() != study.trials.front().appraiser.empty())
      entry.fail("part", "either all runs name their appraiser or none does");
    entry.finish();
    study.trials.push_back(std::move(trial));
  }
  yaml.finish();
  return study;
}

}  // namespace gantry
