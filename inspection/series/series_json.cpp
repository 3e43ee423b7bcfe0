#include <cmath>
#include <nlohmann/json.hpp>

#include "gantry/inspection/gauge.h"
#include "gantry/inspection/series.h"

namespace gantry {
namespace {

using Json = nlohmann::ordered_json;

/// NaN, which JSON does not know, as null.
Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json estimate(const Estimate& e) {
  if (!std::isfinite(e.value)) return nullptr;
  return {{"value", e.value}, {"low", number(e.low)}, {"high", number(e.high)}};
}

Json numbers(const std::vector<double>& values) {
  Json list = Json::array();
  for (const double v : values) list.push_back(number(v));
  return list;
}

Json run_json(const SeriesRun& run) {
  return {{"name", run.name},
          {"created", run.created},
          {"verdict", to_string(run.verdict)},
          {"counts", run.doubt.empty()},
          {"doubt", run.doubt},
          {"simulated", run.simulated},
          {"tolerance_mm", run.tolerance_mm}};
}

Json chart_json(const ControlChart& c) {
  Json json{{"name", c.name},
            {"words", c.words},
            {"in_control", c.in_control()},
            {"used", c.used},
            {"baseline", c.baseline},
            {"centre_mm", c.centre_mm},
            {"sigma_mm", c.sigma_mm},
            {"lower_mm", c.lower_mm},
            {"upper_mm", c.upper_mm},
            {"range_mean_mm", c.range_mean_mm},
            {"range_upper_mm", c.range_upper_mm},
            {"uncertainty_mm", number(c.uncertainty_mm)},
            {"cp", estimate(c.capability.cp)},
            {"cpk", estimate(c.capability.cpk)},
            {"pp", estimate(c.capability.pp)},
            {"ppk", estimate(c.capability.ppk)},
            {"drift_per_run_mm", estimate(c.drift.per_run_mm)},
            {"drift_total_mm", c.drift.total_mm},
            {"drift_significant", c.drift.significant},
            {"values_mm", numbers(c.values)},
            {"moving_ranges_mm", numbers(c.moving_ranges)},
            {"signals", Json::array()}};
  for (const ControlSignal& s : c.signals)
    json["signals"].push_back(
        {{"first_run", s.first}, {"last_run", s.last}, {"rule", s.rule}, {"words", s.words}});
  return json;
}

Json line_json(const VarianceLine& line) {
  return {{"freedoms", line.freedoms}, {"squares_mm2", line.squares}, {"mean_square_mm2", line.mean_square}};
}

Json gauge_result_json(const GaugeResult& r) {
  return {{"name", r.name},
          {"words", r.words},
          {"anova",
           {{"part", line_json(r.part)},
            {"appraiser", line_json(r.appraiser)},
            {"interaction", line_json(r.interaction)},
            {"repeatability", line_json(r.repeatability)},
            {"total", line_json(r.total)},
            {"interaction_p", r.interaction_p},
            {"pooled", r.pooled}}},
          {"repeatability_mm", estimate(r.ev_mm)},
          {"reproducibility_mm", estimate(r.av_mm)},
          {"part_variation_mm", estimate(r.pv_mm)},
          {"grr_mm", estimate(r.grr_mm)},
          {"total_variation_mm", r.tv_mm},
          {"percent_of_study", estimate(r.percent_study)},
          {"percent_of_tolerance", estimate(r.percent_tolerance)},
          {"ndc", estimate(r.ndc)},
          {"by_study", gauge_words(r.percent_study.value)},
          {"by_tolerance", gauge_words(r.percent_tolerance.value)},
          {"values_mm", numbers(r.values)}};
}

/// Text that is not UTF-8 (a folder's name) must not cost the result.
std::string dumped(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string_view name_of(ControlRules rules) {
  switch (rules) {
    case ControlRules::kLimits:
      return "limits";
    case ControlRules::kWesternElectric:
      return "western-electric";
    case ControlRules::kNelson:
      return "nelson";
  }
  return "limits";
}

}  // namespace

std::string trend_json(const Series& series, const Trend& trend, const TrendOptions& options,
                       const std::string& created, const std::string& software) {
  Json json{{"part", series.runs.front().part},
            {"created", created},
            {"software", software},
            {"cad_sha256", series.runs.front().cad_sha256},
            {"figure", to_string(options.figure)},
            {"rules", name_of(options.rules)},
            {"baseline", options.baseline},
            {"signalling", trend.signalling},
            {"expected_false", trend.expected_false},
            {"beyond_chance", trend.beyond_chance},
            {"furthest", trend.furthest},
            {"warnings", series.warnings},
            {"runs", Json::array()},
            {"faces", Json::array()},
            {"regions", Json::array()}};
  for (const SeriesRun& run : series.runs) json["runs"].push_back(run_json(run));
  for (const ControlChart& chart : trend.faces) json["faces"].push_back(chart_json(chart));
  for (const ControlChart& chart : trend.regions) json["regions"].push_back(chart_json(chart));
  return dumped(json);
}

std::string gauge_json(const GaugeReport& report, const std::string& created, const std::string& software) {
  Json json{{"study", report.study.name},
            {"created", created},
            {"software", software},
            {"figure", to_string(report.figure)},
            {"tolerance_mm", report.tolerance_mm},
            {"parts", report.parts},
            {"appraisers", report.appraisers},
            {"trials", report.trials},
            {"warnings", report.warnings},
            {"not_seen_by_all", report.unseen},
            {"faces", Json::array()},
            {"regions", Json::array()}};
  for (const GaugeResult& result : report.faces) json["faces"].push_back(gauge_result_json(result));
  for (const GaugeResult& result : report.regions) json["regions"].push_back(gauge_result_json(result));
  return dumped(json);
}

}  // namespace gantry
