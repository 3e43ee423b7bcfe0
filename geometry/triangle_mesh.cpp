#include "gantry/geometry/triangle_mesh.h"

namespace gantry {
namespace {

Eigen::Vector3d doubled_area_vector(const TriangleMesh& mesh, size_t t) {
  const Eigen::Vector3i& tri = mesh.triangles[t];
  const Eigen::Vector3d a = mesh.vertices[tri[0]].cast<double>();
  return (mesh.vertices[tri[1]].cast<double>() - a).cross(mesh.vertices[tri[2]].cast<double>() - a);
}

}  // namespace

Eigen::AlignedBox3f TriangleMesh::bounds() const {
  Eigen::AlignedBox3f box;
  for (const auto& v : vertices) box.extend(v);
  return box;
}

Eigen::Vector3f TriangleMesh::normal(size_t t) const {
  return doubled_area_vector(*this, t).stableNormalized().cast<float>();
}

double TriangleMesh::area(size_t t) const {
  return 0.5 * doubled_area_vector(*this, t).norm();
}

double TriangleMesh::surface_area() const {
  double sum = 0;
  for (size_t t = 0; t < triangles.size(); ++t) sum += area(t);
  return sum;
}

double TriangleMesh::volume() const {
  double sum = 0;
  const Eigen::Vector3d origin =
      vertices.empty() ? Eigen::Vector3d::Zero() : Eigen::Vector3d(vertices[0].cast<double>());
  for (size_t t = 0; t < triangles.size(); ++t) {
    const Eigen::Vector3d a = vertices[triangles[t][0]].cast<double>() - origin;
    sum += a.dot(doubled_area_vector(*this, t)) / 6.0;
  }
  return sum;
}

TriangleMesh transformed(const TriangleMesh& mesh, const Pose& target_from_mesh) {
  TriangleMesh result = mesh;
  for (auto& v : result.vertices) v = (target_from_mesh * v.cast<double>()).cast<float>();
  return result;
}

TriangleMesh merged(const TriangleMesh& a, const TriangleMesh& b) {
  TriangleMesh result = a;
  const int offset = static_cast<int>(a.vertices.size());
  result.vertices.insert(result.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles) result.triangles.push_back(t + Eigen::Vector3i::Constant(offset));
  return result;
}

}  // namespace gantry
