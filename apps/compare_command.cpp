#include "compare_command.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/inspection/distances.h"
#include "reference_mesh.h"

namespace gantry {
namespace {

struct Options {
  std::filesystem::path compared, reference, json, ply;
  std::vector<std::string> metrics = {"all"};
  std::string unit = "mm", reference_unit = "mm";
  size_t samples = 0;
  DistanceOptions distances;
};

std::string meaning_of(Metric metric, const DistanceOptions& o) {
  char text[120];
  switch (metric) {
    case Metric::kChamfer:
      return "mean distance to the nearest point, both ways averaged";
    case Metric::kChamferSquared:
      return "mean squared distance to the nearest point, both ways added";
    case Metric::kHausdorff:
      return "largest distance to the nearest point, either way";
    case Metric::kPercentileHausdorff:
      std::snprintf(text, sizeof text, "%g %% are nearer to the nearest point, either way", o.percentile);
      return text;
    case Metric::kEarthMovers:
      return "mean distance of partners, one to one (Earth Mover's)";
    case Metric::kPlane:
      std::snprintf(text, sizeof text, "mean distance to planes through %zu points of B", o.neighbours);
      return text;
    case Metric::kQuadric:
      std::snprintf(text, sizeof text, "mean distance to quadrics through %zu points of B", o.neighbours);
      return text;
    case Metric::kTriangulation:
      std::snprintf(text, sizeof text, "mean distance to triangles of %zu points of B", o.neighbours);
      return text;
    case Metric::kCloudToMesh:
      return "mean distance to the mesh B; signed: positive outside";
    case Metric::kM3c2:
      return "mean distance along normals, averaged in cylinders; signed";
  }
  return {};
}

std::vector<Metric> metrics_of(const Options& o, bool mesh) {
  std::vector<Metric> metrics;
  for (const std::string& name : o.metrics) {
    if (name != "all") {
      metrics.push_back(*metric_named(name));
      continue;
    }
    // First what the field `distance` of the PLY shows.
    if (mesh) metrics.push_back(Metric::kCloudToMesh);
    for (const Metric m : all_metrics())
      if (m != Metric::kCloudToMesh) metrics.push_back(m);
  }
  std::vector<Metric> unique;
  for (const Metric m : metrics)
    if (std::find(unique.begin(), unique.end(), m) == unique.end()) unique.push_back(m);
  return unique;
}

void require_writable(const std::string& option, const std::filesystem::path& file) {
  if (file.empty()) return;
  if (std::filesystem::is_directory(file))
    throw InputError(option + ": " + file.string() + " is a folder; a file is expected");
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  if (!std::filesystem::is_directory(folder))
    throw InputError(option + ": the folder " + folder.string() + " does not exist");
  require_writable_folder(option, folder);
}

PointCloud read_cloud(const std::filesystem::path& path, double unit_mm) {
  size_t dropped = 0;
  PointCloud cloud = read_point_cloud(path, unit_mm, &dropped);
  if (dropped > 0)
    spdlog::warn("{}: {} points without finite coordinates were left out", path.string(), dropped);
  return cloud;
}

/// What M3C2's levels of detection say of the points that have one.
struct Detection {
  size_t points = 0, exceeded = 0;
  double mean_lod95_mm = 0;
  double share() const {
    return points == 0 ? 0 : static_cast<double>(exceeded) / static_cast<double>(points);
  }
};

Detection detection_of(const DistanceResult& r) {
  Detection d;
  for (size_t i = 0; i < r.lod95_mm.size(); ++i) {
    if (!std::isfinite(r.lod95_mm[i])) continue;
    ++d.points;
    d.mean_lod95_mm += r.lod95_mm[i];
    d.exceeded += std::abs(r.distance_mm[i]) > r.lod95_mm[i];
  }
  if (d.points > 0) d.mean_lod95_mm /= static_cast<double>(d.points);
  return d;
}

/// Whatever a reader must know of one result besides its numbers; empty: nothing.
std::string remarks_on(const DistanceResult& r) {
  std::string remarks = r.note;
  char text[120];
  if (r.error_bound_mm > 0) {
    std::snprintf(text, sizeof text, "; wrong by %.4g mm at most", r.error_bound_mm);
    remarks += text;
  }
  if (r.beside_border > 0) {
    std::snprintf(text, sizeof text,
                  "%s%zu points lie beside the border of the mesh: their sign means little",
                  remarks.empty() ? "" : "; ", r.beside_border);
    remarks += text;
  }
  if (r.metric == Metric::kM3c2) {
    const Detection d = detection_of(r);
    std::snprintf(text, sizeof text, "; mean LOD95 %.4g mm, exceeded by %.1f %% of %zu points",
                  d.mean_lod95_mm, 100 * d.share(), d.points);
    remarks += text;
  }
  return remarks;
}

std::string mesh_words(const SignedDistance& mesh) {
  return std::to_string(mesh.mesh().triangles.size()) + " triangles, " + analyse_topology(mesh.mesh()).text();
}

void print_table(const std::vector<DistanceResult>& results, const Options& o, const PointCloud& compared,
                 const DistanceReference& reference) {
  std::printf("\n  A  %s, %zu points\n  B  %s, %s%zu points\n%s", o.compared.c_str(), compared.size(),
              o.reference.c_str(), reference.mesh() ? "mesh; for metrics between clouds sampled at " : "",
              reference.cloud().size(), reference.mesh() ? "" : "\n");
  if (reference.mesh()) std::printf("     %s\n\n", mesh_words(*reference.mesh()).c_str());
  std::printf("  %-20s  %12s       %10s  %10s  %10s  %10s   %s\n", "metric", "value", "mean", "sigma", "p95",
              "max", "what the value is");
  for (const DistanceResult& r : results) {
    const DistanceSummary& s = r.summary;
    std::printf("  %-20s  %12.6g %-3s   %10.4g  %10.4g  %10.4g  %10.4g   %s\n",
                std::string(to_string(r.metric)).c_str(), r.value, unit_of(r.metric) == "mm2" ? "mm²" : "mm",
                s.mean, s.sigma, s.p95, s.max, meaning_of(r.metric, o.distances).c_str());
  }
  std::printf("\n  mean, sigma, p95 and max: of the points of A, with their sign where they have one; mm\n");
  for (const DistanceResult& r : results) {
    const std::string remarks = remarks_on(r);
    if (!remarks.empty())
      std::printf("  %s: %s\n", std::string(to_string(r.metric)).c_str(), remarks.c_str());
  }
}

/// NaN, which JSON does not know, as null.
nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json json_of(const std::vector<DistanceResult>& results, const Options& o,
                       const PointCloud& compared, const DistanceReference& reference) {
  nlohmann::json json{{"compared", {{"file", o.compared.filename().string()}, {"points", compared.size()}}},
                      {"reference",
                       {{"file", o.reference.filename().string()},
                        {"kind", reference.mesh() ? "mesh" : "cloud"},
                        {"points", reference.cloud().size()}}},
                      {"options",
                       {{"k", o.distances.neighbours},
                        {"percentile", o.distances.percentile},
                        {"registration_mm", o.distances.registration_mm}}},
                      {"software", "gantry " GANTRY_VERSION},
                      {"metrics", nlohmann::json::array()}};
  if (const SignedDistance* mesh = reference.mesh()) {
    const MeshTopology topology = analyse_topology(mesh->mesh());
    json["reference"]["mesh"] = {{"triangles", mesh->mesh().triangles.size()},
                                 {"watertight", topology.watertight()},
                                 {"words", topology.text()}};
  }
  for (const DistanceResult& r : results) {
    const DistanceSummary& s = r.summary;
    nlohmann::json metric{{"name", to_string(r.metric)},
                          {"value", number(r.value)},
                          {"unit", unit_of(r.metric)},
                          {"meaning", meaning_of(r.metric, o.distances)},
                          {"note", r.note},
                          {"distances_mm",
                           {{"count", s.count},
                            {"mean", s.mean},
                            {"sigma", s.sigma},
                            {"rms", s.rms},
                            {"min", s.min},
                            {"max", s.max},
                            {"p05", s.p05},
                            {"p50", s.p50},
                            {"p95", s.p95}}}};
    if (r.metric == Metric::kCloudToMesh) metric["points_beside_border"] = r.beside_border;
    if (r.metric == Metric::kEarthMovers) metric["error_bound_mm"] = r.error_bound_mm;
    if (r.metric == Metric::kM3c2) {
      const Detection d = detection_of(r);
      metric["lod95"] = {{"mean_mm", d.mean_lod95_mm}, {"exceeded", d.share()}};
    }
    json["metrics"].push_back(std::move(metric));
  }
  return json;
}

/// The cloud as it was given, `distance` of the first metric, distance_NAME of the others and lod95 of M3C2.
void write_ply(const std::filesystem::path& path, const PointCloud& cloud,
               const std::vector<DistanceResult>& results) {
  std::vector<ScalarField> fields;
  for (const DistanceResult& r : results) {
    std::string name = "distance";
    if (!fields.empty()) name += "_" + std::string(to_string(r.metric));
    std::replace(name.begin(), name.end(), '-', '_');
    fields.push_back({name, r.distance_mm});
    if (!r.lod95_mm.empty()) fields.push_back({"lod95", r.lod95_mm});
  }
  write_point_cloud(path, cloud, fields);
}

/// There is no verdict here that a wrong unit could spoil, and a patch may be compared with the whole: a
/// warning.
void question_sizes(const Options& o, const PointCloud& compared, const DistanceReference& reference) {
  const SizedFile a{o.compared.filename().string(), bulk_size(compared.points), o.unit, "--unit"};
  const SizedFile b{o.reference.filename().string(), bulk_size(reference.cloud().points), o.reference_unit,
                    "--reference-unit"};
  const std::string question = questioned_sizes(a, b, 5);
  if (!question.empty()) spdlog::warn("{}", question);
}

}  // namespace

struct CompareCommand::Impl {
  Options options;
  CLI::App* command = nullptr;
};

CompareCommand::CompareCommand(CLI::App& app) : impl_(std::make_unique<Impl>()) {
  Options& o = impl_->options;
  const CLI::Validator length = number_within(1e-4, 1000);  // mm
  CLI::App* command = impl_->command = app.add_subcommand(
      "compare",
      "How far a cloud A is from a cloud or mesh B, by the usual metrics; nothing is aligned.\n"
      "Example: gantry-fusion compare merged.ply part.stl\n"
      "Example: gantry-fusion compare merged.ply part.stl --metric cloud-to-mesh --ply distances.ply\n"
      "Example: gantry-fusion compare today.ply yesterday.ply --metric m3c2,hausdorff --registration-mm "
      "0.02");
  command->add_option("A", o.compared, "The compared cloud (PLY or PCD)")->required();
  command
      ->add_option("B", o.reference,
                   "The reference: a cloud (PLY, PCD) or a mesh (STL, OBJ, STEP, PLY with faces)")
      ->required();
  std::vector<std::string> names = {"all"};
  for (const Metric m : all_metrics()) names.emplace_back(to_string(m));
  command->add_option("--metric", o.metrics, "One or more, separated by commas; all: those that B allows")
      ->delimiter(',')
      ->allow_extra_args(false)  // what follows are A and B
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command->add_option("--k", o.distances.neighbours, "Neighbours of the local models")
      ->check(CLI::Range(3, 64))
      ->capture_default_str();
  command->add_option("--percentile", o.distances.percentile, "Of percentile-hausdorff")
      ->check(number_within(0.001, 100))
      ->capture_default_str();
  command
      ->add_option("--registration-mm", o.distances.registration_mm,
                   "Standard uncertainty of A's place relative to B, mm: part of M3C2's level of detection")
      ->check(number_within(0, 1000))
      ->capture_default_str();
  command
      ->add_option("--normal-diameter-mm", o.distances.m3c2_normal_diameter_mm,
                   "M3C2: scale of the normals; default: from the spacing of the points")
      ->check(length);
  command
      ->add_option("--cylinder-diameter-mm", o.distances.m3c2_cylinder_diameter_mm,
                   "M3C2: width of the cylinder; default: from the spacing of the points")
      ->check(length);
  command
      ->add_option("--depth-mm", o.distances.m3c2_depth_mm,
                   "M3C2: reach of the cylinder to either side; default: beyond the nearest points")
      ->check(length);
  command
      ->add_option("--samples", o.samples,
                   "Points drawn from a mesh B for metrics between clouds; default: as many as A has")
      ->check(CLI::Range(4, 100'000'000));
  command->add_option("--unit", o.unit, "Unit of A; results are in mm")
      ->check(CLI::IsMember(length_units()))
      ->capture_default_str();
  command->add_option("--reference-unit", o.reference_unit, "Unit of B; a STEP file states its own")
      ->check(CLI::IsMember(length_units()))
      ->capture_default_str();
  command->add_option("--json", o.json, "File for the results");
  command->add_option(
      "--ply", o.ply,
      "File for A with a scalar field `distance`, of the first metric, and `distance_NAME` of "
      "each other one");
}

CompareCommand::~CompareCommand() = default;

bool CompareCommand::parsed() const {
  return impl_->command->parsed();
}

ExitCode CompareCommand::run() const {
  const Options& o = impl_->options;
  require_writable("--json", o.json);
  require_writable("--ply", o.ply);
  const PointCloud compared = read_cloud(o.compared, millimetres_in(o.unit));
  const bool mesh = holds_triangles(o.reference);
  const DistanceReference reference =
      mesh ? DistanceReference(read_reference(o.reference, o.reference_unit, "--reference-unit", true).mesh,
                               o.samples > 0 ? o.samples : compared.size())
           : DistanceReference(read_cloud(o.reference, millimetres_in(o.reference_unit)));
  question_sizes(o, compared, reference);
  const auto results = compare(compared, reference, metrics_of(o, mesh), o.distances);
  print_table(results, o, compared, reference);
  if (!o.json.empty()) {
    std::ofstream file(o.json);
    file << json_of(results, o, compared, reference).dump(2) << "\n";
    if (!file.flush()) throw InputError(o.json.string() + ": cannot be written");
  }
  if (!o.ply.empty()) write_ply(o.ply, compared, results);
  return ExitCode::kPass;
}

}  // namespace gantry
