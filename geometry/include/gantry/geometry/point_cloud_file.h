#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"

namespace gantry {

/// One number a point, to be stored beside the coordinates.
struct ScalarField {
  std::string name;
  std::span<const float> values;
};

/// Reads PLY or PCD: points, normals and a field `sigma` (standard uncertainty, same unit; 0 or more, else
/// InputError) when present. Points that are not finite are an error here (a scan may have gaps, a cloud may
/// not): they are dropped and counted in `dropped` if given, otherwise InputError is thrown.
PointCloud read_point_cloud(const std::filesystem::path& path, double unit_mm = 1.0,
                            size_t* dropped = nullptr);

/// Writes binary PLY: x y z, normals if present, then the scalar fields, in the order of the points.
void write_point_cloud(const std::filesystem::path& path, const PointCloud& cloud,
                       const std::vector<ScalarField>& fields = {});

}  // namespace gantry
