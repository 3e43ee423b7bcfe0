#include "gantry/fusion/registration_json.h"

#include <sys/resource.h>

#include <Eigen/Eigenvalues>
#include <fstream>
#include <nlohmann/json.hpp>

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

/// Largest standard uncertainties of a pose, as a person reads them.
nlohmann::json observability(const Matrix6d& covariance) {
  const auto largest = [](const Eigen::Matrix3d& m) {
    return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues()(2)));
  };
  return {{"rotation_sigma_deg", largest(covariance.topLeftCorner<3, 3>()) * 180.0 / std::acos(-1.0)},
          {"translation_sigma_mm", largest(covariance.bottomRightCorner<3, 3>())}};
}

}  // namespace

void write_registration(const std::filesystem::path& folder, const FusionResult& result) {
  std::filesystem::create_directories(folder);
  std::vector<Pose> poses;
  nlohmann::json json;
  json["method"] = "refined-pose-graph";
  json["trusted"] = result.trusted;
  json["reason"] = result.reason;
  for (const auto& scan : result.scans) {
    poses.push_back(scan.part_from_sensor.mean);
    json["scans"].push_back({{"name", scan.name},
                             {"world_from_scan", rows(scan.part_from_sensor.mean.matrix())},
                             {"covariance", rows(scan.part_from_sensor.covariance())},
                             {"observability", observability(scan.part_from_sensor.covariance())},
                             {"moved_mm", scan.moved_mm},
                             {"rms_mm", scan.rms_mm},
                             {"noise_mm", scan.noise_mm},
                             {"points_measured", scan.measured},
                             {"points_used", scan.points},
                             {"connected", scan.connected}});
  }
  json["edges"] = nlohmann::json::array();
  for (const auto& edge : result.edges) {
    json["edges"].push_back({{"target", edge.target},
                             {"source", edge.source},
                             {"kind", edge.odometry ? "odometry" : "loop closure"},
                             {"predicted_overlap", edge.predicted_overlap},
                             {"overlap", edge.match.overlap},
                             {"inliers", edge.match.inliers},
                             {"rms_mm", edge.match.rms_mm},
                             {"normalised_rms", edge.match.normalised_rms},
                             {"iterations", edge.match.iterations},
                             {"disagreement_mm", edge.disagreement_mm},
                             {"kept", edge.kept},
                             {"reason", edge.reason}});
  }
  json["overlap_rms_mm"] = {
      {"before", result.before.rms_mm}, {"after", result.after.rms_mm}, {"matches", result.after.matches}};
  json["merged"] = {{"points", result.merged.size()},
                    {"voxel_mm", result.voxel_mm},
                    {"normals_flipped", result.normals_flipped}};
  for (const auto& [stage, seconds] : result.timings_s) json["timings_s"][stage] = seconds;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  json["peak_memory_mb"] = static_cast<double>(usage.ru_maxrss) / 1024.0;

  write_poses(folder / "poses.txt", poses);
  write_point_cloud(folder / "merged.ply", result.merged, {{"sigma", result.merged.sigma_mm}});
  std::ofstream file(folder / "registration.json");
  file << json.dump(2) << "\n";
  if (!file.flush()) throw InputError((folder / "registration.json").string() + ": cannot be written");
}

}  // namespace gantry
