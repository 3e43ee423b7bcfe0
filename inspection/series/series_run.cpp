#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/inspection/series.h"

namespace gantry {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

constexpr std::array kFigures{SeriesFigure::kMean, SeriesFigure::kSigma, SeriesFigure::kP05,
                              SeriesFigure::kP95,  SeriesFigure::kMin,   SeriesFigure::kMax};

/// One object of a JSON file, read with messages that name file and key.
class Fields {
 public:
  Fields(const Json& json, const fs::path& file, std::string where)
      : json_(json), file_(file), where_(std::move(where)) {
    if (!json.is_object()) fail("", "an object is expected");
  }

  [[noreturn]] void fail(const std::string& key, const std::string& message) const {
    std::string name = where_;
    if (!key.empty()) name += (name.empty() ? "" : ".") + key;
    throw InputError(file_.string() + ": " + (name.empty() ? "" : name + ": ") + message);
  }
  const Json* find(const std::string& key) const {
    const auto found = json_.find(key);
    return found == json_.end() || found->is_null() ? nullptr : &*found;
  }
  std::string text(const std::string& key) const {
    const Json* value = find(key);
    if (!value || !value->is_string()) fail(key, "a text is expected");
    return value->get<std::string>();
  }
  std::string text_or(const std::string& key, const std::string& fallback) const {
    return find(key) ? text(key) : fallback;
  }
  /// Finite: no deviation is larger than a kilometre.
  double number(const std::string& key) const {
    const Json* value = find(key);
    if (!value || !value->is_number()) fail(key, "a number is expected");
    const double number = value->get<double>();
    if (!(std::abs(number) <= 1e6)) fail(key, "is no plausible number");
    return number;
  }
  double number_or(const std::string& key, double fallback) const {
    return find(key) ? number(key) : fallback;
  }

 private:
  const Json& json_;
  const fs::path& file_;
  std::string where_;
};

Json parse(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(file.string() + ": cannot be opened");
  try {
    return Json::parse(stream);
  } catch (const Json::exception& e) {
    // "[json.exception.parse_error.101] parse error at line 3, column 1: ...": the part for people.
    std::string message = e.what();
    message.erase(0, std::min(message.find("] ") + 2, message.size()));
    throw InputError(file.string() + ": is not valid JSON (truncated?): " + message);
  }
}

/// The report that `path` stands for.
fs::path report_of(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) throw InputError(path.string() + ": no such run");
  if (!fs::is_directory(path, error)) return path;
  for (const fs::path& inside : {path / "inspection" / "report.json", path / "report.json"})
    if (fs::exists(inside, error)) return inside;
  throw InputError(
      path.string() +
      ": no inspection/report.json and no report.json in it: was this run inspected (gantry-cell run "
      "with --reference, or gantry-fusion inspect)?");
}

SeriesFeature read_feature(const Fields& f) {
  SeriesFeature feature;
  feature.name = f.text("name");
  feature.words = f.text_or("words", "");
  feature.mean_mm = f.number("mean_mm");
  feature.sigma_mm = f.number("sigma_mm");
  feature.p05_mm = f.number("p05_mm");
  feature.p95_mm = f.number("p95_mm");
  feature.min_mm = f.number("min_mm");
  feature.max_mm = f.number("max_mm");
  feature.uncertainty_mm = f.number_or("uncertainty_mm", std::numeric_limits<double>::quiet_NaN());
  if (feature.sigma_mm < 0) f.fail("sigma_mm", "must not be negative");
  if (feature.uncertainty_mm < 0) f.fail("uncertainty_mm", "must not be negative");
  return feature;
}

std::vector<SeriesFeature> read_features(const Json& json, const fs::path& file, const std::string& key) {
  std::vector<SeriesFeature> features;
  if (!json.contains(key)) return features;
  const Json& list = json.at(key);
  if (!list.is_array()) throw InputError(file.string() + ": " + key + ": a list is expected");
  std::set<std::string> names;
  for (size_t i = 0; i < list.size(); ++i) {
    const Fields fields(list[i], file, key + "[" + std::to_string(i) + "]");
    if (!names.insert(fields.text("name")).second) fields.fail("name", "occurs twice");
    if (fields.number("points") > 0) features.push_back(read_feature(fields));
  }
  return features;
}

/// "bracket.stl, sha256 12ab..." as inspections write it.
void read_cad(const Json& json, const fs::path& file, SeriesRun& run) {
  const auto trace = json.find("traceability");
  if (trace != json.end()) {
    const std::string entry = Fields(*trace, file, "traceability").text_or("CAD model", "");
    constexpr std::string_view kMark = ", sha256 ";
    const size_t mark = entry.rfind(kMark);
    if (mark != std::string::npos) {
      run.cad = entry.substr(0, mark);
      run.cad_sha256 = entry.substr(mark + kMark.size());
    }
  }
  if (run.cad_sha256.empty())
    throw InputError(file.string() +
                     ": traceability.CAD model: does not tell the model's sha256, so that it is not "
                     "known of which part the run is");
}

/// Why the registration of a run folder is not to be relied on; empty: it is, or there was none.
std::string registration_doubt(const fs::path& report) {
  const fs::path file = report.parent_path().parent_path() / "registration" / "registration.json";
  std::error_code error;
  if (report.parent_path().filename() != "inspection" || !fs::exists(file, error)) return {};
  const Json json = parse(file);
  const Fields fields(json, file, "");
  const Json* trusted = fields.find("trusted");
  if (!trusted || !trusted->is_boolean()) fields.fail("trusted", "true or false is expected");
  if (trusted->get<bool>()) return {};
  return "its registration is not to be relied on: " + fields.text_or("reason", "no reason given");
}

/// The folder that a person would call the run.
std::string run_name(const fs::path& report) {
  fs::path folder = report.parent_path();
  if (folder.filename() == "inspection") folder = folder.parent_path();
  return folder.filename().string().empty() ? report.string() : folder.filename().string();
}

bool same_figures(const SeriesRun& a, const SeriesRun& b) {
  const auto same = [](const std::vector<SeriesFeature>& x, const std::vector<SeriesFeature>& y) {
    return std::equal(
        x.begin(), x.end(), y.begin(), y.end(), [](const SeriesFeature& f, const SeriesFeature& g) {
          return f.name == g.name && std::all_of(kFigures.begin(), kFigures.end(), [&](SeriesFigure figure) {
                   return value_of(f, figure) == value_of(g, figure);
                 });
        });
  };
  return same(a.faces, b.faces) && same(a.regions, b.regions);
}

/// Throws for what makes no series; what is only odd is returned.
std::vector<std::string> check_together(const std::vector<SeriesRun>& runs) {
  std::set<double> tolerances;
  size_t simulated = 0;
  for (size_t i = 0; i < runs.size(); ++i) {
    const SeriesRun& run = runs[i];
    if (run.cad_sha256 != runs.front().cad_sha256)
      throw InputError(run.name + " was inspected against another CAD model than " + runs.front().name +
                       " (" + run.cad + ", sha256 " + run.cad_sha256.substr(0, 12) + "; " + runs.front().cad +
                       ", sha256 " + runs.front().cad_sha256.substr(0, 12) +
                       "): their faces cannot be compared");
    for (size_t k = 0; k < i; ++k)
      if (run.report == runs[k].report || (run.created == runs[k].created && same_figures(run, runs[k])))
        throw InputError(
            run.name + " is given twice" +
            (run.report == runs[k].report ? "" : ": " + runs[k].name + " is the same measurement"));
    tolerances.insert(run.tolerance_mm);
    simulated += run.simulated;
  }
  std::vector<std::string> warnings;
  if (tolerances.size() > 1) {
    char text[120];
    std::snprintf(text, sizeof text, "the runs' tolerances differ, from %.4g to %.4g mm", *tolerances.begin(),
                  *tolerances.rbegin());
    warnings.emplace_back(text);
  }
  if (simulated > 0 && simulated < runs.size())
    warnings.push_back(std::to_string(simulated) + " of " + std::to_string(runs.size()) +
                       " runs are simulated, the others real");
  return warnings;
}

}  // namespace

std::string_view to_string(SeriesFigure figure) {
  switch (figure) {
    case SeriesFigure::kMean:
      return "mean";
    case SeriesFigure::kSigma:
      return "sigma";
    case SeriesFigure::kP05:
      return "p05";
    case SeriesFigure::kP95:
      return "p95";
    case SeriesFigure::kMin:
      return "min";
    case SeriesFigure::kMax:
      return "max";
  }
  return "mean";
}

std::optional<SeriesFigure> series_figure_named(std::string_view name) {
  for (const SeriesFigure figure : kFigures)
    if (to_string(figure) == name) return figure;
  return std::nullopt;
}

double value_of(const SeriesFeature& f, SeriesFigure figure) {
  switch (figure) {
    case SeriesFigure::kMean:
      return f.mean_mm;
    case SeriesFigure::kSigma:
      return f.sigma_mm;
    case SeriesFigure::kP05:
      return f.p05_mm;
    case SeriesFigure::kP95:
      return f.p95_mm;
    case SeriesFigure::kMin:
      return f.min_mm;
    case SeriesFigure::kMax:
      return f.max_mm;
  }
  return f.mean_mm;
}

SeriesRun read_series_run(const fs::path& path) {
  const fs::path file = report_of(path);
  const Json json = parse(file);
  const Fields fields(json, file, "");
  SeriesRun run;
  std::error_code error;
  run.report = fs::canonical(file, error);
  if (error) throw InputError(file.string() + ": " + error.message());
  run.name = run_name(run.report);
  run.created = fields.text("created");
  run.part = fields.text_or("title", "");
  run.tolerance_mm = fields.number("tolerance_mm");
  if (!(run.tolerance_mm > 0)) fields.fail("tolerance_mm", "must be positive");
  if (const Json* simulated = fields.find("simulated")) {
    if (!simulated->is_boolean()) fields.fail("simulated", "true or false is expected");
    run.simulated = simulated->get<bool>();
  }
  read_cad(json, file, run);
  const std::string verdict = fields.text("verdict");
  bool known = false;
  for (const Verdict v : {Verdict::kPass, Verdict::kFail, Verdict::kUndecided})
    if (to_string(v) == verdict) run.verdict = v, known = true;
  if (!known)
    fields.fail("verdict", "PASS, FAIL or UNDECIDED is expected, found '" + verdict.substr(0, 40) + "'");
  run.doubt = registration_doubt(run.report);
  if (run.doubt.empty() && run.verdict == Verdict::kUndecided)
    run.doubt = "UNDECIDED: " + fields.text_or("reason", "no reason given");
  run.faces = read_features(json, file, "faces");
  run.regions = read_features(json, file, "regions");
  if (run.faces.empty() && run.regions.empty() && run.doubt.empty())
    throw InputError(
        file.string() +
        ": tells of no faces and no regions: inspect this run again with this version of gantry");
  return run;
}

Series make_series(std::vector<SeriesRun> runs) {
  if (runs.size() < 2)
    throw InputError("a series needs at least two runs; found " + std::to_string(runs.size()));
  Series series;
  series.warnings = check_together(runs);
  series.runs = std::move(runs);
  std::stable_sort(series.runs.begin(), series.runs.end(),
                   [](const SeriesRun& a, const SeriesRun& b) { return a.created < b.created; });
  return series;
}

}  // namespace gantry
