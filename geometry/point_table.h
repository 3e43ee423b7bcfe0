#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "cloud_sources_file.h"
#include "gantry/geometry/pose.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// What a PLY or PCD file holds, in the file's unit. The two readers are our own because those of PCL and
/// Assimp crash, or ask for gigabytes, on files whose header does not fit their body.
struct PointTable {
  size_t width = 0;
  size_t height = 0;  ///< 1: not organised.
  /// Numbers of width * height points by the name of their field; NaN in the gaps of a grid. Only x, y, z,
  /// normal_x, normal_y, normal_z (also called nx, ny, nz in files), sigma and scans are kept. Double:
  /// rounded before it is brought to mm, a file in another unit would not give the same points.
  std::map<std::string, std::vector<double>> columns;
  Eigen::Vector3d sensor_position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d sensor_axes = Eigen::Matrix3d::Identity();  ///< A rotation, or else the file is wrong.
  std::vector<Eigen::Vector3i> triangles;                     ///< Polygons as fans; none beside a grid.
  RawSources sources;                                         ///< Empty unless a PLY has them.

  bool has(const std::string& field) const { return columns.contains(field); }
};

/// By the file's extension; x, y and z are there, and at least one point. Throws InputError naming the file
/// when it is missing, broken or truncated.
PointTable read_points(const std::filesystem::path& path);

/// The column that a field of this name fills, null when it is not kept.
std::vector<double>* column_for(PointTable& table, const std::string& field);

PointTable read_ply(const std::filesystem::path& path);
PointTable read_pcd(const std::filesystem::path& path);

}  // namespace gantry::internal
