#pragma once

#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gantry/inspection/inspection.h"

namespace gantry {

/// Many inspections of parts of one type, seen together: is the process that makes them steady (control
/// charts), does it make them well enough (capability), where is it heading (drift), and how much of what is
/// seen comes from the measurement itself (gauge R&R, see gauge.h). All figures are deviations from the CAD
/// model in mm.

/// What one run found on one CAD face or on one tile of the CAD surface: the entries of `faces` and `regions`
/// in report.json.
struct SeriesFeature {
  std::string name;   ///< The same in all runs of one CAD model: "cylinder 2", "region 17".
  std::string words;  ///< "hole of 8.0 mm along z at (20.0, 10.0)"; may be empty.
  double mean_mm = 0, sigma_mm = 0, p05_mm = 0, p95_mm = 0, min_mm = 0, max_mm = 0;
  double uncertainty_mm = 0;  ///< Standard uncertainty of mean_mm; NaN: the run does not tell.
};

/// Which figure of a feature is followed over the runs.
enum class SeriesFigure { kMean, kSigma, kP05, kP95, kMin, kMax };
std::string_view to_string(SeriesFigure figure);  ///< "mean", "sigma", "p05", ...
std::optional<SeriesFigure> series_figure_named(std::string_view name);
double value_of(const SeriesFeature& feature, SeriesFigure figure);

struct SeriesRun {
  std::filesystem::path report;  ///< The report.json, without links and dots.
  std::string name;              ///< The folder's, for people.
  std::string created;           ///< ISO 8601; runs are put in its order.
  std::string part;              ///< Title of the report.
  std::string cad;               ///< "bracket.stl", for messages.
  std::string cad_sha256;
  double tolerance_mm = 0;
  bool simulated = false;
  Verdict verdict = Verdict::kUndecided;
  std::string doubt;  ///< Why the run is shown but counts for nothing: "UNDECIDED: ..."; empty: it counts.
  std::vector<SeriesFeature> faces, regions;
};

/// Reads a run folder (RUN/inspection/report.json, and RUN/registration/registration.json for whether the
/// registration is trusted), an inspection folder or a report.json. Faces and regions of which nothing was
/// seen are left out. Throws InputError naming file and key.
SeriesRun read_series_run(const std::filesystem::path& path);

/// A series of runs in the order of their dates.
struct Series {
  std::vector<SeriesRun> runs;
  std::vector<std::string> warnings;  ///< "tolerances differ: ...".
};

/// Puts runs in order. Throws InputError for fewer than two runs, a run given twice, or runs of different CAD
/// models; different tolerances, and simulated runs among real ones, are warned of.
Series make_series(std::vector<SeriesRun> runs);

/// Which tests a control chart applies besides the limits themselves.
enum class ControlRules {
  kLimits,           ///< Beyond three sigma only: one false alarm in 370 points.
  kWesternElectric,  ///< And 2 of 3 beyond two sigma, 4 of 5 beyond one sigma, 8 in a row on one side: one
                     ///< in 92.
  kNelson            ///< Nelson's eight (Journal of Quality Technology 16, 1984).
};

/// A pattern that chance makes seldom, ending at `last`.
struct ControlSignal {
  size_t first = 0, last = 0;  ///< Indices of runs.
  std::string rule;            ///< "Western Electric 2".
  std::string words;           ///< "2 of 3 beyond two sigma, above".
};

/// A number and the interval that holds its true value with 95 % probability.
struct Estimate {
  double value = std::numeric_limits<double>::quiet_NaN();
  double low = std::numeric_limits<double>::quiet_NaN(), high = std::numeric_limits<double>::quiet_NaN();
};

/// Capability against -tolerance ... +tolerance. Cp and Cpk take sigma from the moving ranges (what the
/// process can do while nothing shifts), Pp and Ppk from all values (what it did). NaN where sigma is 0.
struct Capability {
  Estimate cp, cpk, pp, ppk;
};

/// The straight line through the values over the number of the run, by least squares.
struct Drift {
  Estimate per_run_mm;       ///< Slope, with its 95 % interval by Student's t.
  double total_mm = 0;       ///< From the first to the last run that counts, along the line.
  bool significant = false;  ///< The interval does not hold 0.
};

/// Individuals and moving range (Montgomery, "Introduction to Statistical Quality Control", chapter 6.4).
/// Limits from the moving ranges of the baseline: mean +- 2.66 MR, and 3.267 MR for the ranges.
struct ControlChart {
  std::string name, words;
  std::vector<double> values;          ///< By run; NaN where the run did not see the feature.
  std::vector<double> moving_ranges;   ///< By run: from the run before that counts; NaN for the first.
  size_t used = 0, baseline = 0;       ///< Runs that count; of them, those that the limits come from.
  double centre_mm = 0, sigma_mm = 0;  ///< Mean of the baseline; mean moving range / 1.128.
  double lower_mm = 0, upper_mm = 0, range_mean_mm = 0, range_upper_mm = 0;
  double uncertainty_mm = 0;           ///< Of a value, root mean square over the runs; NaN: not told.
  std::vector<ControlSignal> signals;  ///< Rule by rule, the limits first.
  Capability capability;
  Drift drift;
  bool in_control() const { return signals.empty(); }
};

struct TrendOptions {
  SeriesFigure figure = SeriesFigure::kMean;
  ControlRules rules = ControlRules::kWesternElectric;
  size_t baseline = 0;  ///< So many of the first runs that count set the limits; 0: all of them.
};

struct Trend {
  std::vector<ControlChart> faces, regions;
  size_t signalling = 0;  ///< Charts with a signal.
  /// Charts that would show one by chance alone if every process were steady: simulated for independent runs,
  /// with limits from as few runs as these.
  double expected_false = 0;
  /// More charts signal than chance makes (once in 40 times), or a value lies so far out that chance makes it
  /// once in 100 such trends. False although charts signal: as much as is to be expected of so many.
  bool beyond_chance = false;
  std::string furthest;  ///< Which chart has that value; empty: none lies so far out.
};

/// One chart for every face and region that at least two of the runs that count have seen. Throws InputError
/// when fewer than two runs count, when the baseline is longer than those, or when there is no face or
/// region.
Trend analyse_trend(const Series& series, const TrendOptions& options);

/// Writes `trend.html` (one self-contained file) and `trend.json` into `folder`, which must exist. Returns
/// the path of trend.html.
std::filesystem::path write_trend(const std::filesystem::path& folder, const Series& series,
                                  const Trend& trend, const TrendOptions& options, const std::string& created,
                                  const std::string& software);
/// The text of trend.json.
std::string trend_json(const Series& series, const Trend& trend, const TrendOptions& options,
                       const std::string& created, const std::string& software);

}  // namespace gantry
