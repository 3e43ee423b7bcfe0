#include "gantry/geometry/scan_file.h"

#include <pcl/io/pcd_io.h>

#include <cmath>

#include "gantry/foundation/error.h"
#include "pcl_blob.h"

namespace gantry {

ScanFile read_scan(const std::filesystem::path& path, double unit_mm) {
  const internal::PclBlob blob = internal::read_blob(path);
  const std::vector<float> x = internal::field_values(blob, "x", path);
  const std::vector<float> y = internal::field_values(blob, "y", path);
  const std::vector<float> z = internal::field_values(blob, "z", path);
  ScanFile file;
  file.scan.width = static_cast<int>(blob.cloud.width);
  file.scan.height = static_cast<int>(blob.cloud.height);
  file.scan.points.resize(x.size());
  for (size_t i = 0; i < x.size(); ++i) {
    const bool finite = std::isfinite(x[i]) && std::isfinite(y[i]) && std::isfinite(z[i]);
    file.scan.points[i] = finite ? Eigen::Vector3f((Eigen::Vector3d(x[i], y[i], z[i]) * unit_mm).cast<float>())
                                 : invalid_point();
  }
  if (file.scan.valid_count() == 0) throw InputError(path.string() + ": holds no finite point");
  const Eigen::Quaterniond rotation = blob.orientation.cast<double>();
  if (!(std::abs(rotation.norm() - 1.0) < 1e-3) || !blob.origin.allFinite())
    throw InputError(path.string() + ": its VIEWPOINT is not a rigid pose");
  file.part_from_sensor.linear() = rotation.normalized().toRotationMatrix();
  file.part_from_sensor.translation() = blob.origin.head<3>().cast<double>() * unit_mm;
  file.has_pose = !file.part_from_sensor.isApprox(Pose::Identity(), 1e-9);
  return file;
}

void write_scan(const std::filesystem::path& path, const Scan& scan, const Pose& part_from_sensor) {
  pcl::PCLPointCloud2 blob = internal::make_blob(scan.width, scan.height, {"x", "y", "z"});
  for (size_t i = 0; i < scan.points.size(); ++i)
    for (int k = 0; k < 3; ++k) internal::set_value(blob, i, k, scan.points[i][k]);
  Eigen::Vector4f origin = Eigen::Vector4f::Zero();
  origin.head<3>() = part_from_sensor.translation().cast<float>();
  const Eigen::Quaternionf orientation(Eigen::Quaterniond(part_from_sensor.linear()).cast<float>());
  std::filesystem::path partial = path;
  partial += ".partial";
  int status = -1;
  try {
    status = pcl::PCDWriter().writeBinary(partial.string(), blob, origin, orientation);
  } catch (const std::exception& e) {
    throw InputError(path.string() + ": cannot be written: " + e.what());
  }
  if (status < 0) throw InputError(path.string() + ": cannot be written");
  internal::publish(partial, path);
}

}  // namespace gantry
