#include "gantry/inspection/gauge.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "gantry/foundation/error.h"
#include "series/probability.h"

namespace gantry {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPool = 0.25;  ///< AIAG: an interaction less certain than this is taken for repeatability.
constexpr double kSpread = 6;   ///< Of a study variation, in standard deviations (AIAG, 4th edition).
constexpr double kDistinct = 1.41;    ///< Of ndc.
constexpr double kMostDistinct = 99;  ///< Beyond this the number says nothing more.
constexpr size_t kDraws = 4000;

/// Components of variance, mm^2, at least 0. What the study does not tell is NaN.
struct Components {
  double part = kNaN, appraiser = kNaN, interaction = 0, repeatability = 0;
};

/// The mean squares, pooled where there is no interaction to speak of.
struct MeanSquares {
  double part = 0, appraiser = 0, interaction = 0, repeatability = 0;
};

struct Design {
  double parts, appraisers, trials;
  bool crossed() const { return parts > 1 && appraisers > 1; }
};

/// By the method of moments (AIAG, table III-B 7 and what follows it).
Components components_of(const MeanSquares& ms, const Design& d, bool pooled) {
  Components c;
  c.repeatability = ms.repeatability;
  // What parts and appraisers are compared with: what they share.
  const double below = d.crossed() && !pooled ? ms.interaction : ms.repeatability;
  if (d.crossed() && !pooled) c.interaction = std::max(0.0, (ms.interaction - ms.repeatability) / d.trials);
  if (d.parts > 1) c.part = std::max(0.0, (ms.part - below) / (d.appraisers * d.trials));
  if (d.appraisers > 1) c.appraiser = std::max(0.0, (ms.appraiser - below) / (d.parts * d.trials));
  return c;
}

/// What people ask for, from the components.
struct Figures {
  double ev, av = kNaN, pv = kNaN, grr, tv, percent_study = kNaN, percent_tolerance, ndc = kNaN;
};

Figures figures_of(const Components& c, double tolerance_mm) {
  Figures f{};
  const double reproducibility = std::isfinite(c.appraiser) ? c.appraiser + c.interaction : 0;
  f.ev = std::sqrt(c.repeatability);
  f.av = std::isfinite(c.appraiser) ? std::sqrt(reproducibility) : kNaN;
  f.grr = std::sqrt(c.repeatability + reproducibility);
  f.pv = std::isfinite(c.part) ? std::sqrt(c.part) : kNaN;
  f.tv = std::isfinite(c.part) ? std::hypot(f.grr, f.pv) : f.grr;
  f.percent_tolerance = 100 * kSpread * f.grr / (2 * tolerance_mm);
  f.percent_study = std::isfinite(c.part) && f.tv > 0 ? 100 * f.grr / f.tv : kNaN;
  f.ndc = !std::isfinite(c.part) || !(f.tv > 0) ? kNaN
          : f.grr > 0                           ? std::min(kMostDistinct, kDistinct * f.pv / f.grr)
                                                : kMostDistinct;
  return f;
}

/// Draws of freedoms / chi-square for the four lines: what turns a mean square into a plausible truth.
std::vector<MeanSquares> draws_for(const GaugeResult& r) {
  std::mt19937_64 random(20'260'101);
  const auto factors = [&](size_t freedoms) {
    std::vector<double> all(kDraws, 0.0);
    if (freedoms == 0) return all;
    std::gamma_distribution<double> half_chi_square(static_cast<double>(freedoms) / 2, 2);
    for (double& factor : all) factor = static_cast<double>(freedoms) / half_chi_square(random);
    return all;
  };
  const size_t within = r.repeatability.freedoms + (r.pooled ? r.interaction.freedoms : 0);
  const auto part = factors(r.part.freedoms), appraiser = factors(r.appraiser.freedoms),
             interaction = factors(r.interaction.freedoms), repeatability = factors(within);
  std::vector<MeanSquares> draws;
  for (size_t i = 0; i < kDraws; ++i)
    draws.push_back({part[i], appraiser[i], interaction[i], repeatability[i]});
  return draws;
}

Estimate estimate(double value, std::vector<double> drawn) {
  if (!std::isfinite(value) || drawn.empty()) return {value, kNaN, kNaN};
  std::sort(drawn.begin(), drawn.end());
  const auto at = [&](double p) {
    return drawn[static_cast<size_t>(p * static_cast<double>(drawn.size() - 1))];
  };
  return {value, at(0.025), at(0.975)};
}

void add_intervals(GaugeResult& r, const MeanSquares& ms, const Design& design, double tolerance_mm) {
  std::vector<double> ev, av, pv, grr, study, tolerance, ndc;
  for (const MeanSquares& factor : draws_for(r)) {
    const MeanSquares plausible{ms.part * factor.part, ms.appraiser * factor.appraiser,
                                ms.interaction * factor.interaction, ms.repeatability * factor.repeatability};
    const Figures f = figures_of(components_of(plausible, design, r.pooled), tolerance_mm);
    ev.push_back(f.ev);
    av.push_back(f.av);
    pv.push_back(f.pv);
    grr.push_back(f.grr);
    tolerance.push_back(f.percent_tolerance);
    if (std::isfinite(f.percent_study)) study.push_back(f.percent_study);
    if (std::isfinite(f.ndc)) ndc.push_back(std::floor(f.ndc));
  }
  const Figures f = figures_of(components_of(ms, design, r.pooled), tolerance_mm);
  r.ev_mm = estimate(f.ev, std::move(ev));
  r.av_mm = estimate(f.av, std::move(av));
  r.pv_mm = estimate(f.pv, std::move(pv));
  r.grr_mm = estimate(f.grr, std::move(grr));
  r.tv_mm = f.tv;
  r.percent_study = estimate(f.percent_study, std::move(study));
  r.percent_tolerance = estimate(f.percent_tolerance, std::move(tolerance));
  r.ndc = estimate(std::floor(f.ndc), std::move(ndc));
}

void set(VarianceLine& line, size_t freedoms, double squares) {
  line = {freedoms, squares, freedoms > 0 ? squares / static_cast<double>(freedoms) : 0};
}

/// Sums of squares about the means of cells, rows and columns.
void add_variance_lines(GaugeResult& r, const GaugeTable& t) {
  const size_t p = t.parts.size(), k = t.appraisers.size(), n = t.trials;
  std::vector<double> part(p, 0.0), appraiser(k, 0.0), cell(p * k, 0.0);
  double mean = 0;
  for (size_t i = 0; i < p; ++i)
    for (size_t j = 0; j < k; ++j) {
      for (size_t m = 0; m < n; ++m) cell[i * k + j] += t.at(i, j, m) / static_cast<double>(n);
      part[i] += cell[i * k + j] / static_cast<double>(k);
      appraiser[j] += cell[i * k + j] / static_cast<double>(p);
      mean += cell[i * k + j] / static_cast<double>(p * k);
    }
  const auto squared = [](double v) { return v * v; };
  double parts = 0, appraisers = 0, interaction = 0, within = 0, total = 0;
  for (size_t i = 0; i < p; ++i) {
    parts += static_cast<double>(k * n) * squared(part[i] - mean);
    for (size_t j = 0; j < k; ++j) {
      if (i == 0) appraisers += static_cast<double>(p * n) * squared(appraiser[j] - mean);
      interaction += static_cast<double>(n) * squared(cell[i * k + j] - part[i] - appraiser[j] + mean);
      for (size_t m = 0; m < n; ++m) {
        within += squared(t.at(i, j, m) - cell[i * k + j]);
        total += squared(t.at(i, j, m) - mean);
      }
    }
  }
  set(r.part, p - 1, parts);
  set(r.appraiser, k - 1, appraisers);
  set(r.interaction, (p - 1) * (k - 1), interaction);
  set(r.repeatability, p * k * (n - 1), within);
  set(r.total, p * k * n - 1, total);
}

template <typename Key>
std::vector<std::string> distinct(const std::vector<GaugeTrial>& trials, Key key) {
  std::vector<std::string> names;
  for (const GaugeTrial& trial : trials)
    if (std::find(names.begin(), names.end(), trial.*key) == names.end()) names.push_back(trial.*key);
  return names;
}

/// Index of the run of every place in a GaugeTable. Throws unless the study is balanced.
std::vector<size_t> places_of(const GaugeStudy& study, GaugeReport& report) {
  report.parts = distinct(study.trials, &GaugeTrial::part);
  report.appraisers = distinct(study.trials, &GaugeTrial::appraiser);
  std::vector<size_t> places;
  for (const std::string& part : report.parts)
    for (const std::string& appraiser : report.appraisers) {
      size_t count = 0;
      for (size_t i = 0; i < study.trials.size(); ++i)
        if (study.trials[i].part == part && study.trials[i].appraiser == appraiser) {
          places.push_back(i);
          ++count;
        }
      if (report.trials == 0) report.trials = count;
      if (count != report.trials)
        throw InputError("gauge study " + study.name + ": part " + part +
                         (appraiser.empty() ? "" : ", appraiser " + appraiser) + " has " +
                         std::to_string(count) + " runs where part " + report.parts.front() +
                         (appraiser.empty() ? "" : ", appraiser " + report.appraisers.front()) + " has " +
                         std::to_string(report.trials) +
                         "; every appraiser must measure every part equally often");
    }
  return places;
}

/// The feature of that name in every run, in the order of `places`; empty when a run has not seen it.
std::vector<double> values_of(const std::string& name, std::vector<SeriesFeature> SeriesRun::*features,
                              const std::vector<SeriesRun>& runs, const std::vector<size_t>& places,
                              SeriesFigure figure) {
  std::vector<double> values;
  for (const size_t place : places) {
    const auto& list = runs[place].*features;
    const auto found =
        std::find_if(list.begin(), list.end(), [&](const SeriesFeature& f) { return f.name == name; });
    if (found == list.end()) return {};
    values.push_back(value_of(*found, figure));
  }
  return values;
}

}  // namespace

std::string gauge_words(double percent) {
  if (!std::isfinite(percent)) return {};
  return percent < 10 ? "acceptable" : percent <= 30 ? "conditional" : "not acceptable";
}

GaugeResult analyse_gauge(const GaugeTable& table, double tolerance_mm) {
  const auto require = [](bool ok, const std::string& what) {
    if (!ok) throw InputError("gauge study: " + what);
  };
  require(!table.parts.empty() && !table.appraisers.empty(), "there are no parts, or no appraisers");
  require(table.trials >= 2,
          "every part must be measured at least twice by each appraiser: what one measurement "
          "repeats is not known otherwise");
  require(table.values.size() == table.parts.size() * table.appraisers.size() * table.trials,
          "the table is not complete");
  require(std::all_of(table.values.begin(), table.values.end(), [](double v) { return std::isfinite(v); }),
          "a value is not a finite number");
  require(tolerance_mm > 0 && std::isfinite(tolerance_mm), "the tolerance must be positive");
  GaugeResult r;
  r.values = table.values;
  add_variance_lines(r, table);
  const Design design{static_cast<double>(table.parts.size()), static_cast<double>(table.appraisers.size()),
                      static_cast<double>(table.trials)};
  MeanSquares ms{r.part.mean_square, r.appraiser.mean_square, r.interaction.mean_square,
                 r.repeatability.mean_square};
  if (design.crossed()) {
    if (ms.interaction > 0)
      r.interaction_p =
          series::fisher_above(ms.interaction / ms.repeatability, static_cast<double>(r.interaction.freedoms),
                               static_cast<double>(r.repeatability.freedoms));
    r.pooled = r.interaction_p > kPool;
    if (r.pooled)
      ms.repeatability = (r.interaction.squares + r.repeatability.squares) /
                         static_cast<double>(r.interaction.freedoms + r.repeatability.freedoms);
  }
  add_intervals(r, ms, design, tolerance_mm);
  return r;
}

GaugeReport analyse_gauge_study(const GaugeStudy& study, const std::vector<SeriesRun>& runs,
                                SeriesFigure figure) {
  if (runs.size() != study.trials.size())
    throw InputError("gauge study: as many runs as trials are expected");
  GaugeReport report;
  report.study = study;
  report.figure = figure;
  report.warnings = make_series(runs).warnings;
  report.tolerance_mm = runs.front().tolerance_mm;
  for (const SeriesRun& run : runs)
    if (!run.doubt.empty())
      throw InputError("gauge study " + study.name + ": " + run.name + " counts for nothing (" + run.doubt +
                       "): measure that part once more");
  const std::vector<size_t> places = places_of(study, report);
  for (const auto& [features, results] :
       {std::pair{&SeriesRun::faces, &report.faces}, std::pair{&SeriesRun::regions, &report.regions}}) {
    std::set<std::string> done;
    for (const SeriesRun& run : runs)
      for (const SeriesFeature& feature : run.*features) {
        if (!done.insert(feature.name).second) continue;
        const GaugeTable table{report.parts, report.appraisers, report.trials,
                               values_of(feature.name, features, runs, places, figure)};
        if (table.values.empty()) {
          report.unseen.push_back(feature.name);
          continue;
        }
        results->push_back(analyse_gauge(table, report.tolerance_mm));
        results->back().name = feature.name;
        results->back().words = feature.words;
      }
  }
  if (report.faces.empty() && report.regions.empty())
    throw InputError("gauge study " + study.name + ": no face or region was seen by all of its runs");
  return report;
}

}  // namespace gantry
