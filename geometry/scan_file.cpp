#include "gantry/geometry/scan_file.h"

#include <cmath>
#include <fstream>
#include <iomanip>

#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "pcd_tag.h"
#include "pcl_blob.h"

namespace gantry {
namespace {

/// Rotations of an error have no unit, translations have that of the points.
void to_mm(UncertainPose& pose, double unit_mm) {
  pose.mean.translation() *= unit_mm;
  Vector6d scale;
  scale << Eigen::Vector3d::Ones(), Eigen::Vector3d::Constant(unit_mm);
  pose.shared_factor = scale.asDiagonal() * pose.shared_factor;
  pose.independent = scale.asDiagonal() * pose.independent * scale.asDiagonal();
}

void write(const std::filesystem::path& path, const Scan& scan, const Pose& part_from_sensor,
           const std::string& comments) {
  std::filesystem::path partial = path;
  partial += ".partial";
  {
    // Written here because PCL's writer rounds the VIEWPOINT to six digits: 5 um at a metre.
    std::ofstream file(partial, std::ios::binary);
    const Eigen::Vector3d t = part_from_sensor.translation();
    const Eigen::Quaterniond q(part_from_sensor.linear());
    file << "# .PCD v0.7 - Point Cloud Data file format\n"
         << comments << "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
         << "WIDTH " << scan.width << "\nHEIGHT " << scan.height << "\nVIEWPOINT " << std::setprecision(17)
         << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' '
         << q.z() << "\nPOINTS " << scan.points.size() << "\nDATA binary\n";
    static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float));
    file.write(reinterpret_cast<const char*>(scan.points.data()),
               static_cast<std::streamsize>(scan.points.size() * sizeof(Eigen::Vector3f)));
    if (!file.flush()) throw InputError(path.string() + ": cannot be written");
  }
  internal::publish(partial, path);
}

}  // namespace

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
    file.scan.points[i] = finite
                              ? Eigen::Vector3f((Eigen::Vector3d(x[i], y[i], z[i]) * unit_mm).cast<float>())
                              : invalid_point();
  }
  if (file.scan.valid_count() == 0) throw InputError(path.string() + ": holds no finite point");
  file.part_from_sensor.mean.linear() = blob.orientation.cast<double>().normalized().toRotationMatrix();
  file.part_from_sensor.mean.translation() = blob.origin.head<3>().cast<double>();
  const double norm = blob.orientation.norm();
  if (!(std::abs(norm - 1.0) < 1e-3) || !blob.origin.allFinite())
    throw InputError(path.string() + ": its VIEWPOINT is not a rigid pose");
  if (path.extension() == ".pcd") file.has_uncertainty = internal::read_pcd_tag(path, file.part_from_sensor);
  to_mm(file.part_from_sensor, unit_mm);
  file.has_pose = file.has_uncertainty || !file.part_from_sensor.mean.isApprox(Pose::Identity(), 1e-9);
  return file;
}

void write_scan(const std::filesystem::path& path, const Scan& scan, const Pose& part_from_sensor) {
  write(path, scan, part_from_sensor, "");
}

void write_scan(const std::filesystem::path& path, const Scan& scan, const UncertainPose& part_from_sensor) {
  write(path, scan, part_from_sensor.mean, internal::pcd_tag_comments(part_from_sensor));
}

}  // namespace gantry
