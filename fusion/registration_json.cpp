#include "gantry/fusion/registration_json.h"

#include <sys/resource.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "gantry/foundation/error.h"
#include "gantry/fusion/poses_file.h"
#include "gantry/geometry/point_cloud_file.h"

namespace gantry {
namespace {

nlohmann::json rows(const Eigen::MatrixXd& m) {
  nlohmann::json out = nlohmann::json::array();
  for (Eigen::Index r = 0; r < m.rows(); ++r) {
    nlohmann::json row = nlohmann::json::array();
    for (Eigen::Index c = 0; c < m.cols(); ++c) row.push_back(m(r, c));
    out.push_back(row);
  }
  return out;
}

nlohmann::json scan_json(const ScanResult& scan, const ScanReport* report, bool joint) {
  nlohmann::json json = {{"name", scan.name},
                         {"world_from_scan", rows(scan.part_from_sensor.mean.matrix())},
                         {"covariance", rows(scan.part_from_sensor.covariance())},
                         {"connected", scan.connected},
                         {"left_out", scan.left_out},
                         {"moved_mm", scan.moved_mm},
                         {"turned_deg", scan.turned_rad * 180 / std::numbers::pi},
                         {"rms_mm", scan.rms_mm},
                         {"noise_mm", scan.noise_mm},
                         {"spacing_mm", scan.spacing_mm},
                         {"points",
                          {{"measured", scan.measured},
                           {"used", scan.points},
                           {"dropped_crop", scan.dropped_crop},
                           {"dropped_edges", scan.dropped_edges},
                           {"dropped_hidden", scan.dropped_hidden}}}};
  if (!report) return json;
  json["observability"] = report->observability;
  json["matches"] = report->matches;
  json["matches_rms_mm"] = report->rms_mm;
  json["free_space_violation"] = report->free_space_violation;
  json["opposite_contact"] = report->opposite_contact;
  // A 0 of a method without such a test would look like a perfect score.
  json["prior_chi_square"] = joint ? nlohmann::json(report->prior_chi_square) : nlohmann::json();
  json["leave_one_out_mm"] = joint ? nlohmann::json(report->leave_one_out_mm) : nlohmann::json();
  return json;
}

nlohmann::json edge_json(const PairReport& pair) {
  return {{"target", pair.target},
          {"source", pair.source},
          {"kind", pair.odometry ? "odometry" : "loop closure"},
          {"predicted_overlap", pair.predicted_overlap},
          {"overlap", pair.overlap},
          {"inliers", pair.inliers},
          {"rms_mm", pair.rms_mm},
          {"disagreement_mm", pair.disagreement_mm},
          {"kept", pair.kept},
          {"reason", pair.reason}};
}

}  // namespace

void write_registration(const std::filesystem::path& folder, const FusionResult& result) {
  std::filesystem::create_directories(folder);
  const Registration& registration = result.registration;
  nlohmann::json json;
  json["method"] = to_string(result.method);
  json["way"] = registration.way;
  json["trusted"] = result.trusted;
  json["reason"] = result.reason;
  json["advice"] = result.advice;
  json["left_out"] = nlohmann::json::array();
  for (const ScanResult& scan : result.scans)
    if (!scan.left_out.empty()) json["left_out"].push_back(scan.name);
  json["converged"] = registration.converged;
  json["iterations"] = registration.iterations;
  const bool joint = result.method == RegistrationMethod::kJoint;
  json["wobble_mm"] = joint ? nlohmann::json(registration.wobble_mm) : nlohmann::json();
  json["shared_chi_square"] = joint ? nlohmann::json(registration.shared_chi_square) : nlohmann::json();
  std::vector<Pose> poses;
  for (size_t i = 0; i < result.scans.size(); ++i) {
    poses.push_back(result.scans[i].part_from_sensor.mean);
    json["scans"].push_back(
        scan_json(result.scans[i], i < registration.scans.size() ? &registration.scans[i] : nullptr, joint));
  }
  json["edges"] = nlohmann::json::array();
  for (const PairReport& pair : registration.pairs) json["edges"].push_back(edge_json(pair));
  json["parameters"] = nlohmann::json::object();
  for (const ParameterChoice& choice : registration.parameters)
    json["parameters"][choice.name] = {{"value", choice.value}, {"reason", choice.reason}};
  json["overlap_rms_mm"] = {
      {"before", result.before.rms_mm}, {"after", result.after.rms_mm}, {"matches", result.after.matches}};
  json["merged"] = nullptr;
  if (result.merged.size() > 0)
    json["merged"] = {{"points", result.merged.size()},
                      {"voxel_mm", result.merge.voxel_mm},
                      {"measurements", result.merge.measurements},
                      {"cells", result.merge.cells},
                      {"unsupported", result.merge.unsupported},
                      {"contradicted", result.merge.contradicted},
                      {"duplicates", result.merge.duplicates},
                      {"thinned", result.merge.thinned},
                      {"sides_guessed", result.sides_guessed}};
  for (const auto& [stage, seconds] : result.timings_s) json["timings_s"][stage] = seconds;

  write_poses(folder / "poses.txt", poses);
  if (result.merged.size() > 0) {
    write_point_cloud(folder / "merged.ply", result.merged, {{"sigma", result.merged.sigma_mm}});
  } else {
    std::filesystem::remove(folder / "merged.ply");
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  json["peak_memory_mb"] = static_cast<double>(usage.ru_maxrss) / 1024.0;
  // Names of files need not be UTF-8, which JSON is.
  const std::string text = json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
  std::ofstream file(folder / "registration.json");
  file << text << "\n";
  if (!file.flush()) throw InputError((folder / "registration.json").string() + ": cannot be written");
}

}  // namespace gantry
