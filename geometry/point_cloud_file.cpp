#include "gantry/geometry/point_cloud_file.h"

#include <bit>
#include <cmath>
#include <fstream>

#include "cloud_sources_file.h"
#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "point_table.h"

namespace gantry {

PointCloud read_point_cloud(const std::filesystem::path& path, double unit_mm, size_t* dropped) {
  const internal::PointTable table = internal::read_points(path);
  const std::vector<double>&x = table.columns.at("x"), &y = table.columns.at("y"), &z = table.columns.at("z");
  const bool normals = table.has("normal_x") && table.has("normal_y") && table.has("normal_z");
  const bool sigma = table.has("sigma");
  PointCloud cloud;
  size_t bad = 0;
  std::vector<char> used(x.size(), 1);
  for (size_t i = 0; i < x.size(); ++i) {
    const Eigen::Vector3f point = (Eigen::Vector3d(x[i], y[i], z[i]) * unit_mm).cast<float>();
    if (!point.allFinite()) {
      ++bad;
      used[i] = 0;
      continue;
    }
    cloud.points.push_back(point);
    if (normals)
      cloud.normals.push_back(Eigen::Vector3d(table.columns.at("normal_x")[i],
                                              table.columns.at("normal_y")[i],
                                              table.columns.at("normal_z")[i])
                                  .cast<float>()
                                  .stableNormalized());
    if (!sigma) continue;
    const float sigma_mm = static_cast<float>(table.columns.at("sigma")[i] * unit_mm);
    if (!(sigma_mm >= 0) || !std::isfinite(sigma_mm))
      throw InputError(path.string() + ": point " + std::to_string(i) + " has sigma " +
                       std::to_string(sigma_mm) + "; a standard uncertainty, 0 or more, is expected");
    cloud.sigma_mm.push_back(sigma_mm);
  }
  if (cloud.points.empty()) throw InputError(path.string() + ": holds no finite point");
  if (bad > 0 && !dropped)
    throw InputError(path.string() + ": " + std::to_string(bad) + " of " + std::to_string(x.size()) +
                     " points have a coordinate that is not a finite number");
  if (dropped) *dropped = bad;
  if (!table.sources.shares.empty())
    cloud.sources = internal::sources_of(
        table.sources, table.has("scans") ? table.columns.at("scans") : std::vector<double>{}, used, unit_mm,
        path);
  return cloud;
}

void write_point_cloud(const std::filesystem::path& path, const PointCloud& cloud,
                       const std::vector<ScalarField>& fields) {
  static_assert(std::endian::native == std::endian::little);
  std::filesystem::path partial = path;
  partial += ".partial";
  {
    std::ofstream file(partial, std::ios::binary);
    file << "ply\nformat binary_little_endian 1.0\n";
    if (cloud.sources) internal::write_sources_comments(file, *cloud.sources);
    file << "element vertex " << cloud.size() << "\nproperty float x\nproperty float y\nproperty float z\n";
    if (cloud.has_normals()) file << "property float nx\nproperty float ny\nproperty float nz\n";
    for (const ScalarField& field : fields) file << "property float " << field.name << "\n";
    if (cloud.sources) {
      file << "property ushort scans\n";
      internal::write_sources_elements(file, *cloud.sources);
    }
    file << "end_header\n";
    const auto write = [&](const float* values, size_t count) {
      file.write(reinterpret_cast<const char*>(values), static_cast<std::streamsize>(count * sizeof(float)));
    };
    for (size_t i = 0; i < cloud.size(); ++i) {
      write(cloud.points[i].data(), 3);
      if (cloud.has_normals()) write(cloud.normals[i].data(), 3);
      for (const ScalarField& field : fields) write(&field.values[i], 1);
      if (!cloud.sources) continue;
      const auto scans = static_cast<uint16_t>(cloud.sources->of(i).size());
      file.write(reinterpret_cast<const char*>(&scans), sizeof scans);
    }
    if (cloud.sources) internal::write_sources_body(file, *cloud.sources);
    if (!file.flush()) throw InputError(path.string() + ": cannot be written");
  }
  internal::publish(partial, path);
}

}  // namespace gantry
