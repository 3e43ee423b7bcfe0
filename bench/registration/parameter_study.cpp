#include "bench.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

constexpr const char* kSection = "parameters";

}  // namespace

std::string parameter_study(Bench& bench) {
  const std::string part = "bunny";
  const std::string heading = "## The paper's parameters\n";
  if (!bench.options.has_part(part))
    return heading + "skipped: the bunny's mesh was not given (--bunny FILE)\n\n";
  const std::vector<Band> bands = {{1, 3}, {6, 10}};
  const std::vector<double> voxels = bench.options.quick ? std::vector{2.0} : std::vector{1.0, 2.0, 3.0};
  const ScannedPart scanned(part, bench.options.bunny);
  const ScanSet set = scanned.scan({.noise_seed = 17});
  std::string out;
  for (const Band& band : bands) {
    Table table({"voxel mm", "m", "p = 2", "p = 3", "p = 4"});
    for (const double voxel : voxels) {
      for (const double m : {1.0, 2.0, 3.0, 4.0}) {
        std::vector<std::string> row = {text("%g", voxel), text("%g", m)};
        for (const double p : {2.0, 3.0, 4.0}) {
          const std::string label = band.name() + text(" voxel %g m %g p %g", voxel, m, p);
          bench.progress.stage("parameters: " + label);
          PreparedMethod method =
              prepare(make_paper_study_method({.voxel_size_mm = voxel, .m = m, .p = p}), set);
          RunRecord run = judged_run(method, set, initial_poses(set, band.from, band.to, 2000));
          run.section = kSection;
          run.part = part;
          run.method = "refined-pose-graph";
          run.label = label;
          row.push_back(short_number(run.error.mae16) + " / " + short_number(run.error.dmax_mm));
          bench.records.push_back(std::move(run));
        }
        table.add(std::move(row));
      }
    }
    out += "Initial error " + band.name() + ":\n\n" + table.str();
  }
  return heading +
         "Refined pose graph on the bunny as the paper has it: voxel averages alone, without the last pass "
         "on the "
         "measured points; matches within voxel * m from the start, edges pruned at voxel / p. Mean absolute "
         "element "
         "difference / worst displacement in mm, one draw.\n\n" +
         out;
}

}  // namespace gantry::bench
