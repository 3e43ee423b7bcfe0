#include "gantry/geometry/scan_file.h"

#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>

#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "pcd_tag.h"
#include "point_table.h"

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
  const internal::PointTable table = internal::read_points(path);
  constexpr size_t kMostSide = std::numeric_limits<int>::max();
  if (table.width > kMostSide || table.height > kMostSide)
    throw InputError(path.string() + ": is too large: " + std::to_string(table.width) + " x " +
                     std::to_string(table.height) + " points");
  const std::vector<double>&x = table.columns.at("x"), &y = table.columns.at("y"), &z = table.columns.at("z");
  ScanFile file;
  file.scan.width = static_cast<int>(table.width);
  file.scan.height = static_cast<int>(table.height);
  file.scan.points.resize(x.size());
  for (size_t i = 0; i < x.size(); ++i) {
    const Eigen::Vector3f point = (Eigen::Vector3d(x[i], y[i], z[i]) * unit_mm).cast<float>();
    file.scan.points[i] = point.allFinite() ? point : invalid_point();
  }
  if (file.scan.valid_count() == 0) throw InputError(path.string() + ": holds no finite point");
  const Eigen::Matrix3d& axes = table.sensor_axes;
  if (!(axes.transpose() * axes).isIdentity(1e-3) || axes.determinant() < 0 ||
      !table.sensor_position.allFinite())
    throw InputError(path.string() + ": its VIEWPOINT is not a rigid pose");
  file.part_from_sensor.mean.linear() = Eigen::Quaterniond(axes).normalized().toRotationMatrix();
  file.part_from_sensor.mean.translation() = table.sensor_position;
  if (internal::lower_extension(path) == ".pcd")
    file.has_uncertainty = internal::read_pcd_tag(path, file.part_from_sensor);
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
