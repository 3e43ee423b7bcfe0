#include "point_table.h"

#include <array>
#include <utility>

#include "file_guard.h"
#include "gantry/foundation/error.h"

namespace gantry::internal {

std::vector<double>* column_for(PointTable& table, const std::string& field) {
  constexpr std::array<std::pair<const char*, const char*>, 11> kKept = {{{"x", "x"},
                                                                          {"y", "y"},
                                                                          {"z", "z"},
                                                                          {"normal_x", "normal_x"},
                                                                          {"normal_y", "normal_y"},
                                                                          {"normal_z", "normal_z"},
                                                                          {"nx", "normal_x"},
                                                                          {"ny", "normal_y"},
                                                                          {"nz", "normal_z"},
                                                                          {"sigma", "sigma"},
                                                                          {"scans", "scans"}}};
  for (const auto& [in_file, name] : kKept)
    if (field == in_file) return &table.columns[name];
  return nullptr;
}

PointTable read_points(const std::filesystem::path& path) {
  const std::string extension = lower_extension(path);
  if (extension != ".ply" && extension != ".pcd")
    throw InputError(path.string() + ": point clouds are read from .ply or .pcd, not '" + extension + "'");
  PointTable table = extension == ".ply" ? read_ply(path) : read_pcd(path);
  if (table.width * table.height == 0) throw InputError(path.string() + ": holds no points");
  for (const char* axis : {"x", "y", "z"})
    if (!table.has(axis)) throw InputError(path.string() + ": points have no field '" + axis + "'");
  return table;
}

}  // namespace gantry::internal
