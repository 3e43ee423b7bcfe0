#pragma once

#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "gantry/inspection/series.h"

namespace gantry {

/// A report.json as inspections write it, with faces whose means are given.
inline nlohmann::json report_with(const std::vector<double>& means_mm, const std::string& created,
                                  const std::string& sha256 = std::string(64, 'a')) {
  nlohmann::json json{{"verdict", "PASS"},
                      {"reason", "All is within tolerance."},
                      {"title", "bracket"},
                      {"created", created},
                      {"simulated", true},
                      {"tolerance_mm", 0.2},
                      {"traceability", {{"CAD model", "bracket.stl, sha256 " + sha256}}},
                      {"faces", nlohmann::json::array()},
                      {"regions", nlohmann::json::array()}};
  for (size_t i = 0; i < means_mm.size(); ++i) {
    const double mean = means_mm[i];
    json["faces"].push_back({{"name", "plane " + std::to_string(i + 1)},
                             {"words", "plane, normal +z"},
                             {"centre_mm", {1, 2, 3}},
                             {"normal", {0, 0, 1}},
                             {"area_mm2", 100},
                             {"seen", 0.9},
                             {"points", 1000},
                             {"mean_mm", mean},
                             {"sigma_mm", 0.01},
                             {"p05_mm", mean - 0.016},
                             {"p95_mm", mean + 0.016},
                             {"min_mm", mean - 0.03},
                             {"max_mm", mean + 0.03},
                             {"uncertainty_mm", 0.004}});
  }
  return json;
}

/// "2026-03-01T10:00:00Z" and every hour after it.
inline std::string hour(size_t k) {
  char text[40];
  std::snprintf(text, sizeof text, "2026-03-%02zuT%02zu:00:00Z", 1 + k / 24, k % 24);
  return text;
}

/// Runs in memory, each with one face "plane 1" of the given mean.
inline Series series_of(const std::vector<double>& means_mm) {
  Series series;
  for (size_t r = 0; r < means_mm.size(); ++r) {
    SeriesRun run;
    run.name = "run " + std::to_string(r + 1);
    run.report = "/runs/" + run.name;
    run.created = hour(r);
    run.cad_sha256 = "abc";
    run.tolerance_mm = 0.2;
    run.verdict = Verdict::kPass;
    SeriesFeature feature;
    feature.name = "plane 1";
    feature.mean_mm = means_mm[r];
    feature.uncertainty_mm = 0.004;
    run.faces.push_back(feature);
    series.runs.push_back(run);
  }
  return series;
}

inline std::vector<double> normal_values(size_t count, double mean, double sigma, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(mean, sigma);
  std::vector<double> values(count);
  for (double& v : values) v = normal(random);
  return values;
}

}  // namespace gantry
