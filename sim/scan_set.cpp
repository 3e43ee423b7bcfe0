#include "gantry/sim/scan_set.h"

#include <string>

#include "gantry/foundation/error.h"
#include "gantry/sim/views.h"

namespace gantry {

TriangleMesh scaled_to_height(TriangleMesh mesh, double height_mm) {
  if (!(height_mm > 0))
    throw InputError("height: must be positive, found " + std::to_string(height_mm) + " mm");
  const Eigen::Vector3f centre = mesh.bounds().center();
  const float height = mesh.bounds().sizes().y();
  if (!(height > 0)) throw InputError("height: the part has no extent along y");
  const float scale = static_cast<float>(height_mm) / height;
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = (vertex - centre) * scale;
  return mesh;
}

Scan scan_of_view(const SensorModel& sensor, const RayScene& scene, const std::vector<Pose>& part_from_sensor,
                  size_t view, uint64_t noise_seed) {
  const Pose& pose = part_from_sensor.at(view);
  return trace_scan(sensor, scene, pose, pose, noise_seed, view);
}

Scan without_grid(const Scan& scan) {
  Scan points;
  for (size_t i = 0; i < scan.points.size(); ++i)
    if (scan.valid(i)) points.points.push_back(scan.points[i]);
  points.width = static_cast<int>(points.points.size());
  points.height = 1;
  return points;
}

std::vector<Pose> perturbed_poses(std::span<const Pose> truth, const Eigen::Vector3d& centre, double from,
                                  double to, uint64_t seed) {
  std::vector<Pose> poses;
  for (size_t i = 0; i < truth.size(); ++i)
    poses.push_back(perturbation(seed, i, centre, from, to) * truth[i]);
  return poses;
}

}  // namespace gantry
