#include "ply_mesh.h"

#include <pcl/PolygonMesh.h>
#include <pcl/console/print.h>
#include <pcl/io/ply_io.h>

#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "pcl_blob.h"

namespace gantry::internal {

TriangleMesh read_ply_triangles(const std::filesystem::path& path) {
  const std::string name = path.string();
  require_header(path, "end_header");
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  pcl::PolygonMesh polygons;
  int status = -1;
  try {
    status = pcl::PLYReader().read(name, polygons);
  } catch (const std::exception& e) {
    throw InputError(name + ": not a readable mesh: " + e.what());
  }
  if (status < 0) throw InputError(name + ": not a readable mesh (broken or truncated)");
  PclBlob blob;
  blob.cloud = std::move(polygons.cloud);
  const std::vector<float> x = field_values(blob, "x", path);
  const std::vector<float> y = field_values(blob, "y", path);
  const std::vector<float> z = field_values(blob, "z", path);
  TriangleMesh mesh;
  for (size_t i = 0; i < x.size(); ++i) mesh.vertices.emplace_back(x[i], y[i], z[i]);
  for (const auto& polygon : polygons.polygons) {
    const auto& v = polygon.vertices;
    for (size_t k = 2; k < v.size(); ++k)
      mesh.triangles.emplace_back(static_cast<int>(v[0]), static_cast<int>(v[k - 1]), static_cast<int>(v[k]));
  }
  return mesh;
}

}  // namespace gantry::internal
