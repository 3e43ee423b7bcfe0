#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "method.h"
#include "pose_error.h"
#include "progress.h"
#include "scan_set.h"

namespace gantry::bench {

/// Errors of initial poses, in degrees and in mm (the paper's bands).
struct Band {
  double from = 0, to = 0;
  std::string name() const;
};

struct BenchOptions {
  std::vector<std::string> parts, methods, sections;
  std::vector<Band> bands;
  size_t draws = 10;
  size_t view_sets = 2;  ///< Draws are dealt over so many choices of viewpoints.
  size_t coverage_runs = 100;
  bool quick = false;
  int threads = 0;
  std::filesystem::path bunny, out;

  bool has_part(const std::string& part) const { return part != "bunny" || !bunny.empty(); }
};

/// One registration, judged.
struct RunRecord {
  std::string section, part, method;
  std::string label;  ///< What the section varies: a band, a trouble, parameters.
  size_t draw = 0;
  PoseError error;
  std::string reason;  ///< Of the method, for not trusting its result.
  Spent preparation, registration;
  std::vector<UncertainPose> found;
};

/// Some runs taken together. All runs count, failed ones too.
struct Tally {
  size_t runs = 0;
  size_t successes = 0;           ///< Worst displacement below 1 mm.
  size_t undecided = 0;           ///< The method gave a reason against its result.
  size_t false_success = 0;       ///< Wrong, and the method raised no objection.
  size_t needless_undecided = 0;  ///< Right, and yet the method objected.
  double mae16_median = 0, mae16_worst = 0, dmax_median_mm = 0, dmax_worst_mm = 0;
  Spent preparation, registration;  ///< Medians.
};
Tally tally(const std::vector<const RunRecord*>& runs);

/// What the sections share: options, the record of all runs, the line on the terminal.
struct Bench {
  BenchOptions options;
  std::vector<RunRecord> records;
  Progress progress;

  std::vector<const RunRecord*> select(const std::string& section, const std::string& part,
                                       const std::string& method, const std::string& label = {}) const;
};

/// A method with the scans of a set prepared for it.
struct PreparedMethod {
  std::unique_ptr<Method> method;
  Spent preparation;
};
PreparedMethod prepare(std::unique_ptr<Method> method, const ScanSet& set);

/// Runs it from these initial poses and judges the outcome; the caller says what it was (section, ...).
RunRecord judged_run(PreparedMethod& prepared, const ScanSet& set, const std::vector<UncertainPose>& initial);

// The sections. Each appends to the records, writes its pictures beside the report, and returns its text in
// Markdown.
std::string accuracy_by_band(Bench& bench);
std::string robustness(Bench& bench);
std::string covariance_coverage(Bench& bench);
std::string time_and_memory(Bench& bench);
std::string parameter_study(Bench& bench);

/// What time_and_memory starts in a process of its own, so that the peak of memory is this method's alone:
/// registers the scans that `folder` holds and writes its answer there.
void measure_in_this_process(const std::filesystem::path& folder, const std::string& method);

void write_csv(const std::filesystem::path& path, const std::vector<RunRecord>& records);

}  // namespace gantry::bench
