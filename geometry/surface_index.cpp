#include "gantry/geometry/surface_index.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include "gantry/foundation/error.h"
#include "surface_search.h"
#include "surface_tree.h"

namespace gantry {

struct SurfaceIndex::Impl {
  Impl(TriangleMesh given, const Meanwhile& meanwhile) : mesh(std::move(given)), normals(normals_of(mesh)) {
    tbb::parallel_invoke([&] { tree = internal::SurfaceTree(mesh, normals); },
                         [&] {
                           if (meanwhile) meanwhile(mesh, normals);
                         });
  }
  TriangleMesh mesh;
  std::vector<Eigen::Vector3f> normals;
  internal::SurfaceTree tree;

  static std::vector<Eigen::Vector3f> normals_of(const TriangleMesh& mesh) {
    std::vector<Eigen::Vector3f> normals(mesh.triangles.size());
    tbb::parallel_for(size_t{0}, normals.size(), [&](size_t t) { normals[t] = mesh.normal(t); });
    return normals;
  }
};

SurfaceIndex::SurfaceIndex(TriangleMesh mesh) : SurfaceIndex(std::move(mesh), nullptr) {}

SurfaceIndex::SurfaceIndex(TriangleMesh mesh, const Meanwhile& meanwhile)
    : impl_(std::make_unique<Impl>(std::move(mesh), meanwhile)) {
  if (impl_->tree.triangles == 0)
    throw InputError("a mesh without a triangle that has an area cannot be measured to");
}

SurfaceIndex::~SurfaceIndex() = default;
SurfaceIndex::SurfaceIndex(SurfaceIndex&&) noexcept = default;
SurfaceIndex& SurfaceIndex::operator=(SurfaceIndex&&) noexcept = default;

const TriangleMesh& SurfaceIndex::mesh() const {
  return impl_->mesh;
}
const std::vector<Eigen::Vector3f>& SurfaceIndex::normals() const {
  return impl_->normals;
}

std::optional<SurfaceIndex::Closest> SurfaceIndex::closest(const Eigen::Vector3f& point, float max_distance,
                                                           Hint hint) const {
  return internal::search(impl_->tree, impl_->mesh, point, max_distance, {}, hint.near_triangle,
                          hint.near ? hint.near->surroundings_.get() : nullptr);
}

std::optional<SurfaceIndex::Closest> SurfaceIndex::closest_facing(const Eigen::Vector3f& point,
                                                                  float max_distance,
                                                                  const Eigen::Vector3f& direction,
                                                                  float min_cosine, Hint hint) const {
  return internal::search(impl_->tree, impl_->mesh, point, max_distance, {true, direction, min_cosine},
                          hint.near_triangle, hint.near ? hint.near->surroundings_.get() : nullptr);
}

SurfaceIndex::Neighbourhood::Neighbourhood() : surroundings_(std::make_unique<internal::Surroundings>()) {}
SurfaceIndex::Neighbourhood::~Neighbourhood() = default;

}  // namespace gantry
