#include <Eigen/Cholesky>
#include <algorithm>

#include "bench.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

constexpr const char* kSection = "covariance";
/// 95 % of a chi-square of six degrees of freedom.
constexpr double kChiSquare95 = 12.592;

/// Squared error of each scan but the first in units of the covariance that the method states (a chi-square
/// of six if it is honest). The first scan is the gauge: the truth is moved to where it was kept.
std::vector<double> normalised_squares(const ScanSet& set, const RunRecord& run) {
  std::vector<double> squares;
  const Pose gauge = run.found[0].mean * set.truth[0].inverse();
  for (size_t i = 1; i < run.found.size(); ++i) {
    const Vector6d error = pose_log(gauge * set.truth[i] * run.found[i].mean.inverse());
    const Matrix6d covariance = run.found[i].covariance();
    squares.push_back(error.dot(covariance.ldlt().solve(error)));
  }
  return squares;
}

}  // namespace

std::string covariance_coverage(Bench& bench) {
  Table table({"part", "runs", "scans", "in the 95 % region", "mean square / 6", "dmax mm, median (worst)",
               "undecided"});
  for (const std::string part : {"bunny", "bracket", "slim-lever", "prismatic-block"}) {
    if (!bench.options.has_part(part)) continue;
    const ScannedPart scanned(part, bench.options.bunny);
    size_t scans = 0, inside = 0, left_out = 0;
    double sum = 0;
    for (size_t r = 0; r < bench.options.coverage_runs; ++r) {
      bench.progress.stage("covariance: " + part +
                           text(", run %zu of %zu", r + 1, bench.options.coverage_runs));
      ScanSettings settings;
      settings.noise_seed = 1000 + r;
      settings.view_seed = 1 + r % bench.options.view_sets;
      const ScanSet set = scanned.scan(settings);
      PreparedMethod joint = prepare(make_method("joint"), set);
      RunRecord run = judged_run(joint, set, initial_poses(set, 1, 3, 5000 + r));
      run.section = kSection;
      run.part = part;
      run.method = "joint";
      run.label = "fresh noise";
      run.draw = r;
      // A false success counts: there the stated covariance lies most.
      if (run.reason.empty()) {
        for (const double square : normalised_squares(set, run)) {
          ++scans;
          inside += square < kChiSquare95;
          sum += square / 6;
        }
      } else {
        ++left_out;
      }
      bench.records.push_back(std::move(run));
    }
    const Tally t = tally(bench.select(kSection, part, "joint"));
    const double count = std::max<double>(1, static_cast<double>(scans));
    table.add({part, text("%zu", bench.options.coverage_runs), text("%zu", scans),
               text("%.1f %%", 100 * static_cast<double>(inside) / count), text("%.2f", sum / count),
               short_number(t.dmax_median_mm) + " (" + short_number(t.dmax_worst_mm) + ")",
               text("%zu", left_out)});
  }
  return text(
             "## Is the stated covariance true?\n"
             "Method joint, %zu runs a part with fresh noise and initial poses off by [1,3], eight views, "
             "dealt "
             "over %zu choice(s) of viewpoints. An honest covariance has 95 %% of the scans in the region "
             "that "
             "it calls 95 %% (chi-square, 6 degrees of freedom), and a mean square error of 1 in its own "
             "units: above 1 it promises too much, below it is too careful.\n\n",
             bench.options.coverage_runs, bench.options.view_sets) +
         table.str();
}

}  // namespace gantry::bench
