// What trends are made of: report.json of a run, and GAUGE.yaml. The first byte of an input chooses which;
// the rest is the file.

#include "fuzz.h"
#include "gantry/inspection/gauge.h"
#include "gantry/inspection/series.h"
#include "inspection/series_samples.h"

namespace gantry::fuzz {
namespace {
constexpr char kReport = 'R', kGauge = 'G';
}

std::vector<std::string> seeds() {
  return {kReport + report_with({0.01, -0.02, 0.3}, hour(1)).dump(),
          kGauge +
              std::string(
                  "name: bracket\nruns:\n  - { run: a1, part: A, appraiser: cell 1 }\n"
                  "  - { run: a2, part: A, appraiser: cell 1 }\n  - { run: /b, part: 'B', appraiser: x }\n")};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile report("report.json"), gauge("GAUGE.yaml");
  if (size == 0) return 0;
  const std::string text = fuzz::text_of(data + 1, size - 1);
  fuzz::value_or_input_error([&] {
    if (data[0] == fuzz::kGauge) {
      read_gauge_study(gauge.write(text));
      return;
    }
    // Three runs of it, so that what was read goes all the way.
    SeriesRun run = read_series_run(report.write(text));
    std::vector<SeriesRun> runs(3, run);
    for (size_t i = 0; i < runs.size(); ++i) {
      runs[i].report += std::to_string(i);
      runs[i].created = hour(i);
    }
    const Series series = make_series(runs);
    const TrendOptions options{.rules = ControlRules::kNelson};
    trend_json(series, analyse_trend(series, options), options, "", "");
  });
  return 0;
}
