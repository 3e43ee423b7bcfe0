#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gantry/inspection/series.h"

namespace gantry {

/// Gauge repeatability and reproducibility by analysis of variance (AIAG, "Measurement Systems Analysis", 4th
/// edition, chapter III B): the same parts are measured several times each, by several appraisers (operators,
/// or cells), and the spread is divided into that of the parts and that of the measurement.

/// One run's place in the study.
struct GaugeTrial {
  std::filesystem::path run;
  std::string part, appraiser;
};

struct GaugeStudy {
  std::string name;
  std::vector<GaugeTrial> trials;
};

/// Reads GAUGE.yaml (docs/files.md). Throws InputError with file, line and key.
GaugeStudy read_gauge_study(const std::filesystem::path& file);

/// A balanced table of measurements: value(part, appraiser, trial).
struct GaugeTable {
  std::vector<std::string> parts, appraisers;
  size_t trials = 0;           ///< Of each part by each appraiser.
  std::vector<double> values;  ///< Part by part, in it appraiser by appraiser, in it trial by trial.
  double at(size_t part, size_t appraiser, size_t trial) const {
    return values[(part * appraisers.size() + appraiser) * trials + trial];
  }
};

/// One line of the analysis of variance.
struct VarianceLine {
  size_t freedoms = 0;
  double squares = 0, mean_square = 0;
};

/// Standard deviations in mm. Intervals of 95 % are generalised ones (Burdick, Borror and Montgomery, "Design
/// and Analysis of Gauge R&R Studies", 2005), drawn with a fixed seed.
struct GaugeResult {
  std::string name, words;  ///< Of the feature.
  VarianceLine part, appraiser, interaction, repeatability, total;
  double interaction_p = 1;    ///< Probability of so large an interaction by chance.
  bool pooled = false;         ///< p > 0.25: the interaction counts as repeatability.
  Estimate ev_mm;              ///< Repeatability (equipment variation).
  Estimate av_mm;              ///< Reproducibility, interaction included; NaN with one appraiser.
  Estimate pv_mm;              ///< Part to part; NaN with one part.
  Estimate grr_mm;             ///< sqrt(EV^2 + AV^2).
  double tv_mm = 0;            ///< Total: sqrt(GRR^2 + PV^2).
  Estimate percent_study;      ///< 100 GRR / TV; NaN with one part.
  Estimate percent_tolerance;  ///< 100 * 6 GRR / (2 * tolerance).
  Estimate ndc;                ///< 1.41 PV / GRR, cut to a whole number in `value`; NaN with one part.
  std::vector<double> values;  ///< As in GaugeTable.
};

/// "acceptable" under 10 %, "conditional" to 30 %, "not acceptable" beyond; empty for NaN.
std::string gauge_words(double percent);

/// Throws InputError for a table with fewer than two trials, an incomplete one, and values that are not
/// finite.
GaugeResult analyse_gauge(const GaugeTable& table, double tolerance_mm);

struct GaugeReport {
  GaugeStudy study;
  std::vector<std::string> parts, appraisers;
  size_t trials = 0;
  double tolerance_mm = 0;
  SeriesFigure figure = SeriesFigure::kMean;
  std::vector<GaugeResult> faces, regions;
  std::vector<std::string> unseen;  ///< Features that not all runs have seen: left out.
  std::vector<std::string> warnings;
};

/// One analysis for every face and region that all runs have seen. `runs` in the order of study.trials.
/// Throws InputError for a study that is not balanced (every appraiser measures every part equally often, at
/// least twice), for runs of different CAD models, and for a run that counts for nothing.
GaugeReport analyse_gauge_study(const GaugeStudy& study, const std::vector<SeriesRun>& runs,
                                SeriesFigure figure = SeriesFigure::kMean);

/// As write_trend().
std::filesystem::path write_gauge(const std::filesystem::path& folder, const GaugeReport& report,
                                  const std::string& created, const std::string& software);
std::string gauge_json(const GaugeReport& report, const std::string& created, const std::string& software);

}  // namespace gantry
