extern "C" {
#include <libqhull_r/qhull_ra.h>
}

#include <cstdio>
#include <memory>
#include <vector>

#include "gantry/foundation/error.h"
#include "gantry/kinematics/collision_shapes.h"

namespace gantry {
namespace {

/// Qhull's working memory; released on every way out.
class Qhull {
 public:
  Qhull() { qh_zero(&state_, nullptr); }
  ~Qhull() {
    qh_freeqhull(&state_, !qh_ALL);
    int not_freed = 0, blocks = 0;
    qh_memfreeshort(&state_, &not_freed, &blocks);
  }
  Qhull(const Qhull&) = delete;
  Qhull& operator=(const Qhull&) = delete;
  qhT* get() { return &state_; }

 private:
  qhT state_;
};

}  // namespace

TriangleMesh convex_hull(const TriangleMesh& mesh) {
  std::vector<double> points;
  for (const Eigen::Vector3f& vertex : mesh.vertices)
    points.insert(points.end(), {vertex.x(), vertex.y(), vertex.z()});
  // A file of nothing for Qhull's messages, which it insists on writing.
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> silence(std::fopen("/dev/null", "w"), &std::fclose);
  Qhull hull;
  char command[] = "qhull Qt";  // Qt: facets cut into triangles.
  if (mesh.vertices.size() < 4 || qh_new_qhull(hull.get(), 3, static_cast<int>(mesh.vertices.size()),
                                               points.data(), False, command, nullptr, silence.get()) != 0)
    throw InputError("collision shape: no convex hull; is the mesh flat?");

  TriangleMesh result;
  std::vector<int> index(mesh.vertices.size(), -1);
  qhT* const qh = hull.get();  // the name that Qhull's macros use
  facetT* facet;
  FORALLfacets {
    Eigen::Vector3i triangle;
    int corner = 0;
    vertexT *vertex, **vertexp;
    FOREACHvertex_(facet->vertices) {
      const auto point = static_cast<size_t>(qh_pointid(qh, vertex->point));
      if (index[point] < 0) {
        index[point] = static_cast<int>(result.vertices.size());
        result.vertices.push_back(mesh.vertices[point]);
      }
      if (corner < 3) triangle[corner++] = index[point];
    }
    // The order of a facet's vertices says nothing of its outside; its plane does.
    const auto at = [&](int k) {
      return result.vertices[static_cast<size_t>(triangle[k])].cast<double>().eval();
    };
    const Eigen::Vector3d outwards(facet->normal[0], facet->normal[1], facet->normal[2]);
    if ((at(1) - at(0)).cross(at(2) - at(0)).dot(outwards) < 0) std::swap(triangle[1], triangle[2]);
    result.triangles.push_back(triangle);
  }
  return result;
}

}  // namespace gantry
