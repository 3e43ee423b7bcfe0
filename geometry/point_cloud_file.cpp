#include "gantry/geometry/point_cloud_file.h"

#include <pcl/io/ply_io.h>

#include <cmath>

#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "pcl_blob.h"

namespace gantry {

PointCloud read_point_cloud(const std::filesystem::path& path, double unit_mm, size_t* dropped) {
  const internal::PclBlob blob = internal::read_blob(path);
  const std::vector<float> x = internal::field_values(blob, "x", path);
  const std::vector<float> y = internal::field_values(blob, "y", path);
  const std::vector<float> z = internal::field_values(blob, "z", path);
  std::vector<float> nx, ny, nz;
  const bool normals = internal::has_field(blob, "normal_x") && internal::has_field(blob, "normal_y") &&
                       internal::has_field(blob, "normal_z");
  if (normals) {
    nx = internal::field_values(blob, "normal_x", path);
    ny = internal::field_values(blob, "normal_y", path);
    nz = internal::field_values(blob, "normal_z", path);
  }
  std::vector<float> sigma;
  if (internal::has_field(blob, "sigma")) sigma = internal::field_values(blob, "sigma", path);
  PointCloud cloud;
  size_t bad = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    if (!std::isfinite(x[i]) || !std::isfinite(y[i]) || !std::isfinite(z[i])) {
      ++bad;
      continue;
    }
    cloud.points.push_back((Eigen::Vector3d(x[i], y[i], z[i]) * unit_mm).cast<float>());
    if (normals) cloud.normals.push_back(Eigen::Vector3f(nx[i], ny[i], nz[i]).stableNormalized());
    if (!sigma.empty()) cloud.sigma_mm.push_back(static_cast<float>(sigma[i] * unit_mm));
  }
  if (cloud.points.empty()) throw InputError(path.string() + ": holds no finite point");
  if (bad > 0 && !dropped)
    throw InputError(path.string() + ": " + std::to_string(bad) + " of " + std::to_string(x.size()) +
                     " points have a coordinate that is not a finite number");
  if (dropped) *dropped = bad;
  return cloud;
}

void write_point_cloud(const std::filesystem::path& path, const PointCloud& cloud,
                       const std::vector<ScalarField>& fields) {
  std::vector<std::string> names = {"x", "y", "z"};
  if (cloud.has_normals()) names.insert(names.end(), {"normal_x", "normal_y", "normal_z"});
  for (const auto& field : fields) names.push_back(field.name);
  pcl::PCLPointCloud2 blob = internal::make_blob(cloud.size(), 1, names);
  for (size_t i = 0; i < cloud.size(); ++i) {
    size_t f = 0;
    for (int k = 0; k < 3; ++k) internal::set_value(blob, i, f++, cloud.points[i][k]);
    if (cloud.has_normals())
      for (int k = 0; k < 3; ++k) internal::set_value(blob, i, f++, cloud.normals[i][k]);
    for (const auto& field : fields) internal::set_value(blob, i, f++, field.values[i]);
  }
  std::filesystem::path partial = path;
  partial += ".partial";
  int status = -1;
  try {
    status = pcl::PLYWriter().writeBinary(partial.string(), blob, Eigen::Vector4f::Zero(),
                                          Eigen::Quaternionf::Identity(), true);
  } catch (const std::exception&) {
    status = -1;
  }
  if (status < 0) throw InputError(path.string() + ": cannot be written");
  internal::publish(partial, path);
}

}  // namespace gantry
