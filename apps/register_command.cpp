#include "register_command.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "gantry/acquisition/journal.h"
#include "gantry/fusion/fusion.h"
#include "gantry/fusion/poses_file.h"
#include "gantry/fusion/registration_json.h"
#include "gantry/geometry/scan_file.h"

namespace gantry {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
/// How wrong initial poses may be when nothing is said, one sigma: mm and degrees.
constexpr double kDefaultPrior = 15;

struct Options {
  std::vector<std::filesystem::path> scans;
  std::filesystem::path initial, out;
  std::vector<double> prior;
  std::vector<double> crop;
  std::string method = "joint", pairwise, sampling, unit = "mm", initial_unit = "mm";
  double voxel_size_mm = 0, m = 0, p = 0, max_distance_threshold_mm = 0, edge_prune_threshold_mm = 0;
  double start_mm = 0, noise_mm = 0, merge_voxel_mm = 0;
  size_t allowed_left_out = 0;
  bool merge_uniform = false, no_merge = false, json = false;
};

/// Rotations of the stated size about the scan's own middle: about the origin they would throw it away.
Matrix6d prior_covariance(const Eigen::Vector3d& centre, double sigma_mm, double sigma_deg) {
  Matrix6d at_centre = Matrix6d::Zero();
  at_centre.diagonal().head<3>().setConstant(std::pow(sigma_deg * kRadPerDeg, 2));
  at_centre.diagonal().tail<3>().setConstant(sigma_mm * sigma_mm);
  Pose part_from_centre = Pose::Identity();
  part_from_centre.translation() = centre;
  const Matrix6d a = adjoint(part_from_centre);
  return a * at_centre * a.transpose();
}

Eigen::Vector3d centre_of(const Scan& scan) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < scan.points.size(); ++i)
    if (scan.valid(i)) sum += scan.points[i].cast<double>();
  return sum / static_cast<double>(scan.valid_count());
}

/// A scan to read and, of a run, how it was tagged.
struct Source {
  std::filesystem::path path;
  std::optional<UncertainPose> tag;
};

/// Files as given; a run folder stands for the scans in its journal, in the order of its plan.
std::vector<Source> sources_of(const std::vector<std::filesystem::path>& given) {
  std::vector<Source> sources;
  for (const auto& path : given) {
    if (!std::filesystem::is_directory(path)) {
      sources.push_back({path, std::nullopt});
      continue;
    }
    const std::filesystem::path journal = path / "journal.sqlite";
    if (!std::filesystem::exists(journal))
      throw InputError(path.string() +
                       ": a scan file or a run folder is expected, found a folder without journal.sqlite");
    for (const ScanRecord& record : Journal(journal).scans())
      sources.push_back({path / record.file, record.part_from_sensor});
  }
  if (sources.empty()) throw InputError(given.front().string() + ": its journal holds no scan");
  return sources;
}

/// File names, or whole paths where these are the same. Throws InputError for a file that is given twice.
std::vector<std::string> names_of(const std::vector<Source>& sources) {
  std::map<std::string, size_t> uses;
  std::set<std::filesystem::path> seen;
  for (const auto& [path, tag] : sources) {
    ++uses[path.filename().string()];
    if (!seen.insert(std::filesystem::weakly_canonical(path)).second)
      throw InputError(path.string() + ": is given twice");
  }
  std::vector<std::string> names;
  for (const auto& [path, tag] : sources)
    names.push_back(uses[path.filename().string()] > 1 ? path.string() : path.filename().string());
  return names;
}

FusionOptions fusion_options(const Options& o) {
  FusionOptions options;
  options.method = registration_method(o.method);
  if (!o.crop.empty())
    options.preprocess.crop_part_mm = Eigen::AlignedBox3d(Eigen::Vector3d(o.crop[0], o.crop[1], o.crop[2]),
                                                          Eigen::Vector3d(o.crop[3], o.crop[4], o.crop[5]));
  options.joint.start_mm = o.start_mm;
  options.joint.noise_mm = o.noise_mm;
  options.joint.allowed_left_out = o.allowed_left_out;
  PaperParameters& paper = options.pose_graph.parameters;
  paper.voxel_size_mm = o.voxel_size_mm;
  paper.m = o.m;
  paper.p = o.p;
  paper.max_distance_threshold_mm = o.max_distance_threshold_mm;
  paper.edge_prune_threshold_mm = o.edge_prune_threshold_mm;
  if (o.pairwise == "point-to-plane") options.refined_pairwise = PairwiseMethod::kPointToPlane;
  options.global_icp.max_distance_mm = o.max_distance_threshold_mm;
  for (const auto strategy : {SamplingStrategy::kUniform, SamplingStrategy::kRandom,
                              SamplingStrategy::kNormalSpace, SamplingStrategy::kMaximumLeverage})
    if (o.sampling == to_string(strategy)) options.global_icp.sampling = strategy;
  options.merge.voxel_mm = o.merge_voxel_mm;
  options.merge.uniform_density = o.merge_uniform;
  options.merge_scans = !o.no_merge;
  return options;
}

/// A scan of 80 units is 80 mm or 80 m across; 0.08 units tell that they were metres.
void warn_of_unit(const TaggedScan& scan) {
  constexpr float kLeast_mm = 2, kMost_mm = 20'000;
  Eigen::AlignedBox3f box;
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    if (scan.scan.valid(i)) box.extend(scan.scan.points[i]);
  const float across_mm = box.diagonal().norm();
  if (across_mm < kLeast_mm || across_mm > kMost_mm)
    spdlog::warn("{}: is {:.3g} mm across; is the unit of this file another one (--unit mm or m)?", scan.name,
                 across_mm);
}

/// Reads one scan after the other and keeps of each only its range surface.
FusionResult fuse(const Options& o) {
  const std::vector<Source> sources = sources_of(o.scans);
  const std::vector<std::string> names = names_of(sources);
  const auto in_mm = [](const std::string& unit) { return unit == "m" ? 1000.0 : 1.0; };
  std::vector<Pose> poses;
  if (!o.initial.empty()) poses = read_poses(o.initial, sources.size(), in_mm(o.initial_unit));
  Fusion fusion(fusion_options(o));
  for (size_t i = 0; i < sources.size(); ++i) {
    const auto& [path, tag] = sources[i];
    ScanFile file = read_scan(path, in_mm(o.unit));
    if (poses.empty() && !file.has_pose && !tag)
      throw InputError(path.string() +
                       ": holds no VIEWPOINT; give the initial poses with --initial POSES.txt");
    TaggedScan scan;
    scan.name = names[i];
    scan.part_from_sensor = tag.value_or(file.part_from_sensor);
    if (!poses.empty()) scan.part_from_sensor.mean = poses[i];
    // What the scan says of its own pose holds neither for another one nor against what the user says.
    const bool uncertainty_known = poses.empty() && o.prior.empty() && (tag || file.has_uncertainty);
    if (!uncertainty_known) {
      const auto [sigma_mm, sigma_deg] =
          o.prior.empty() ? std::pair(kDefaultPrior, kDefaultPrior) : std::pair(o.prior[0], o.prior[1]);
      const Pose mean = scan.part_from_sensor.mean;
      scan.part_from_sensor = {};
      scan.part_from_sensor.mean = mean;
      scan.part_from_sensor.independent = prior_covariance(mean * centre_of(file.scan), sigma_mm, sigma_deg);
    }
    scan.scan = std::move(file.scan);
    spdlog::info("scan {} of {}: {}, {} points{}", i + 1, sources.size(), scan.name, scan.scan.valid_count(),
                 scan.scan.organised() ? ", organised" : "");
    fusion.add(scan);
    warn_of_unit(scan);
  }
  return fusion.finish();
}

void log_parameters(const Registration& registration) {
  for (const ParameterChoice& choice : registration.parameters)
    spdlog::info("{} = {:.4g}: {}", choice.name, choice.value, choice.reason);
}

void print_table(const FusionResult& result) {
  size_t width = 4;
  for (const ScanResult& scan : result.scans) width = std::max(width, scan.name.size());
  const auto column = static_cast<int>(width);
  const std::vector<ScanReport>& reports = result.registration.scans;
  std::printf("\n  %-*s    points   moved (mm)   turned (deg)   rms (mm)   held\n", column, "scan");
  for (size_t i = 0; i < result.scans.size(); ++i) {
    const ScanResult& scan = result.scans[i];
    std::string held = i < reports.size() ? reports[i].observability : "";
    if (held.empty()) held = i == 0 ? "the reference" : "not told by this method";
    if (!scan.left_out.empty()) held = "LEFT OUT: " + scan.left_out;
    std::printf("  %-*s  %8zu   %10.3f   %12.3f   %8.4f   %s\n", column, scan.name.c_str(), scan.points,
                scan.moved_mm, scan.turned_rad / kRadPerDeg, scan.rms_mm,
                scan.connected || !scan.left_out.empty() ? held.c_str() : "NOT CONNECTED");
  }
}

void print_summary(const FusionResult& result, const std::filesystem::path& out) {
  print_table(result);
  const auto& pairs = result.registration.pairs;
  const auto kept = std::count_if(pairs.begin(), pairs.end(), [](const PairReport& p) { return p.kept; });
  std::string way = std::string(to_string(result.method));
  if (!result.registration.way.empty()) way += ", " + result.registration.way;
  std::printf("\n  method     %s; %ld of %zu pairs kept\n", way.c_str(), static_cast<long>(kept),
              pairs.size());
  std::printf("  overlap    trimmed RMS %.4f mm (at the initial poses %.4f mm)\n", result.after.rms_mm,
              result.before.rms_mm);
  std::printf("  time      ");
  for (const auto& [stage, seconds] : result.timings_s) std::printf(" %s %.2f s", stage.c_str(), seconds);
  std::printf("\n");
  if (result.merged.size() > 0)
    std::printf("  merged     %s, %zu points, cells of %.3g mm\n", (out / "merged.ply").c_str(),
                result.merged.size(), result.merge.voxel_mm);
  std::printf("  poses      %s\n", (out / "poses.txt").c_str());
}

std::vector<std::string> left_out_names(const FusionResult& result) {
  std::vector<std::string> names;
  for (const ScanResult& scan : result.scans)
    if (!scan.left_out.empty()) names.push_back(scan.name);
  return names;
}

void print_json(const FusionResult& result) {
  nlohmann::json json{{"method", to_string(result.method)},
                      {"trusted", result.trusted},
                      {"reason", result.reason},
                      {"advice", result.advice},
                      {"left_out", left_out_names(result)},
                      {"overlap_rms_before_mm", result.before.rms_mm},
                      {"overlap_rms_after_mm", result.after.rms_mm},
                      {"points", result.merged.size()}};
  std::printf("%s\n", json.dump().c_str());
}

}  // namespace

struct RegisterCommand::Impl {
  Options options;
  CLI::App* command = nullptr;
  /// Options that only some methods use, with the names of these.
  std::vector<std::pair<CLI::Option*, std::vector<std::string>>> of_methods;

  void refuse_options_of_other_methods() const;
};

void RegisterCommand::Impl::refuse_options_of_other_methods() const {
  for (const auto& [option, methods] : of_methods) {
    if (option->count() == 0 || std::find(methods.begin(), methods.end(), options.method) != methods.end())
      continue;
    std::string names;
    for (const std::string& name : methods) names += (names.empty() ? "" : " and ") + name;
    throw InputError(option->get_name() + ": is not used by method " + options.method + ", only by " + names);
  }
}

RegisterCommand::RegisterCommand(CLI::App& app) : impl_(std::make_unique<Impl>()) {
  Options& o = impl_->options;
  const CLI::Validator length = number_within(1e-3, 1000);  // mm
  CLI::App* command = impl_->command =
      app.add_subcommand("register",
                         "Multi-view registration: writes poses.txt, merged.ply and registration.json.\n"
                         "Exit code 4 and a reason when the result is not to be believed.\n"
                         "Example: gantry-fusion register scans/*.pcd --initial POSES.txt --out registered");
  command
      ->add_option("scans", o.scans, "Scans: PLY (a range_grid makes it organised) or PCD; or a run folder")
      ->required();
  auto* initial = command->add_option("--initial", o.initial,
                                      "POSES.txt: a 4x4 world_from_scan for each scan, in mm unless "
                                      "--initial-unit says otherwise; without it "
                                      "each scan's own pose: the run's, or the PCD's VIEWPOINT");
  command->add_option("--initial-unit", o.initial_unit, "Unit of POSES.txt: mm or m")
      ->needs(initial)
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  command
      ->add_option("--prior", o.prior,
                   "Standard deviation of the initial poses about each scan's middle: MM,DEG; default: the "
                   "covariance that scans of a run bring along with their poses, otherwise 15,15")
      ->delimiter(',')
      ->expected(2)
      ->check(number_within(1e-6, 1000));
  command->add_option("--method", o.method, "joint, refined-pose-graph, pose-graph or global-icp")
      ->check(CLI::IsMember({"joint", "refined-pose-graph", "pose-graph", "global-icp"}))
      ->capture_default_str();
  command
      ->add_option("--crop", o.crop, "x0,y0,z0,x1,y1,z1: what lies outside is no part, mm in the part frame")
      ->delimiter(',')
      ->expected(6);
  command
      ->add_option("--unit", o.unit,
                   "Unit of the scan files and of the poses in them: mm or m; results are in mm")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  command->add_option("--out", o.out, "Folder for the results")->required();
  auto* merge_voxel = command->add_option("--merge-voxel", o.merge_voxel_mm,
                                          "Cell of the merged cloud, mm; default: from the point spacing");
  merge_voxel->check(length);
  auto* merge_uniform = command->add_flag("--merge-uniform", o.merge_uniform,
                                          "Even density of the merged cloud, about one point to a cell");
  command->add_flag("--no-merge", o.no_merge, "Poses only, no merged.ply")
      ->excludes(merge_voxel)
      ->excludes(merge_uniform);
  command->add_flag("--json", o.json, "Print the summary as JSON");

  const auto of = [&](std::vector<std::string> methods, CLI::Option* option) {
    std::string names;
    for (const std::string& name : methods) names += (names.empty() ? "Method " : ", ") + name;
    option->group(names);
    impl_->of_methods.emplace_back(option, std::move(methods));
    return option;
  };
  const std::vector<std::string> graphs = {"refined-pose-graph", "pose-graph"};
  of({"joint"}, command->add_option("--start", o.start_mm,
                                    "How far apart matching surfaces may lie at the beginning, mm; default: "
                                    "three sigma of the prior, at most 15 mm"))
      ->check(length);
  of({"joint"}, command->add_option("--noise", o.noise_mm,
                                    "Noise of the sensor, one sigma, mm; default: measured in the scans"))
      ->check(number_within(1e-4, 100));
  of({"joint"},
     command->add_option("--allow-left-out", o.allowed_left_out,
                         "So many scans may be left out of a result that counts (exit code 0): scans "
                         "that contradict the others or are not held by them; default: none"))
      ->check(CLI::Range(0, 1000));
  of({"refined-pose-graph"},
     command->add_option("--pairwise", o.pairwise,
                         "How pairs are registered: generalized-icp (default) or point-to-plane"))
      ->check(CLI::IsMember({"point-to-plane", "generalized-icp"}));
  of(graphs, command->add_option("--voxel-size", o.voxel_size_mm,
                                 "Cell in which points are averaged for the first round, mm; default: leaves "
                                 "about 6000 of each scan"))
      ->check(length);
  of(graphs, command->add_option("--m", o.m,
                                 "Maximum distance threshold = voxel size * m, in [1, 4]; without it the "
                                 "search begins as wide as the prior and ends there with m = 2"))
      ->check(number_within(1, 4));
  of(graphs, command->add_option("--p", o.p, "Edge prune threshold = voxel size / p, in [2, 4]; default 3"))
      ->check(number_within(2, 4));
  of(graphs, command->add_option("--edge-prune-threshold", o.edge_prune_threshold_mm,
                                 "Instead of --p: pairs that disagree with the final poses by more are left "
                                 "out, mm at the scan's centre"))
      ->check(length);
  of({"refined-pose-graph", "pose-graph", "global-icp"},
     command->add_option("--max-distance-threshold", o.max_distance_threshold_mm,
                         "Points further apart never match, mm; pose graphs: instead of --m; global-icp: "
                         "instead of a radius that shrinks from the prior to four point spacings"))
      ->check(length);
  of({"global-icp"}, command->add_option("--sampling", o.sampling,
                                         "How points are chosen: normal-space (default), uniform, random or "
                                         "maximum-leverage"))
      ->check(CLI::IsMember({"normal-space", "uniform", "random", "maximum-leverage"}));
}

RegisterCommand::~RegisterCommand() = default;

bool RegisterCommand::parsed() const {
  return impl_->command->parsed();
}

ExitCode RegisterCommand::run() const {
  const Options& o = impl_->options;
  impl_->refuse_options_of_other_methods();
  require_writable_folder("--out", o.out);
  const FusionResult result = fuse(o);
  log_parameters(result.registration);
  write_registration(o.out, result);
  o.json ? print_json(result) : print_summary(result, o.out);
  for (const ScanResult& scan : result.scans)
    if (!scan.left_out.empty())
      spdlog::warn("left out: {} {}; it is not in merged.ply", scan.name, scan.left_out);
  if (result.trusted) return ExitCode::kPass;
  spdlog::error("UNDECIDED: {}", result.reason);
  spdlog::error("What to do: {}", result.advice);
  return ExitCode::kUndecided;
}

}  // namespace gantry
