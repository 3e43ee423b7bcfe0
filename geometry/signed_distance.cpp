#include "gantry/geometry/signed_distance.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

namespace gantry {
namespace {

/// For every vertex, the lowest index of a vertex at the same position.
std::vector<int> representatives(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<int> order(vertices.size());
  std::iota(order.begin(), order.end(), 0);
  const auto less = [&](int a, int b) {
    const Eigen::Vector3f &p = vertices[a], &q = vertices[b];
    return std::tie(p.x(), p.y(), p.z(), a) < std::tie(q.x(), q.y(), q.z(), b);
  };
  std::sort(order.begin(), order.end(), less);
  std::vector<int> representative(vertices.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && vertices[order[i]] == vertices[order[i - 1]];
    representative[order[i]] = same ? representative[order[i - 1]] : order[i];
  }
  return representative;
}

}  // namespace

SignedDistance::SignedDistance(TriangleMesh mesh) : scene_(std::move(mesh)) {
  const TriangleMesh& m = scene_.mesh();
  const std::vector<int> representative = representatives(m.vertices);
  std::vector<Eigen::Vector3d> sums(m.vertices.size(), Eigen::Vector3d::Zero());
  struct EdgeUse {
    uint64_t key;
    int triangle;
    int slot;
  };
  std::vector<EdgeUse> uses;
  uses.reserve(3 * m.triangles.size());
  for (size_t t = 0; t < m.triangles.size(); ++t) {
    const Eigen::Vector3d n = m.normal(t).cast<double>();
    for (int k = 0; k < 3; ++k) {
      const int i = m.triangles[t][k], j = m.triangles[t][(k + 1) % 3], l = m.triangles[t][(k + 2) % 3];
      const Eigen::Vector3d e1 = (m.vertices[j] - m.vertices[i]).cast<double>();
      const Eigen::Vector3d e2 = (m.vertices[l] - m.vertices[i]).cast<double>();
      sums[representative[i]] += std::atan2(e1.cross(e2).norm(), e1.dot(e2)) * n;
      const auto a = static_cast<uint64_t>(representative[i]), b = static_cast<uint64_t>(representative[j]);
      uses.push_back({std::min(a, b) << 32 | std::max(a, b), static_cast<int>(t), k});
    }
  }
  vertex_normals_.resize(m.vertices.size());
  for (size_t i = 0; i < m.vertices.size(); ++i)
    vertex_normals_[i] = sums[representative[i]].stableNormalized().cast<float>();

  std::sort(uses.begin(), uses.end(), [](const EdgeUse& a, const EdgeUse& b) { return a.key < b.key; });
  edge_normals_.resize(m.triangles.size());
  for (size_t i = 0; i < uses.size();) {
    size_t j = i;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (; j < uses.size() && uses[j].key == uses[i].key; ++j)
      sum += m.normal(uses[j].triangle).cast<double>();
    const Eigen::Vector3f normal = sum.stableNormalized().cast<float>();
    for (; i < j; ++i) edge_normals_[uses[i].triangle][uses[i].slot] = normal;
  }
}

SignedDistance::Value SignedDistance::signed_value(const Eigen::Vector3f& point,
                                                   const RayScene::Closest& closest) const {
  using Feature = RayScene::Feature;
  Value value{closest.distance, closest.point, Eigen::Vector3f::Zero(), closest.triangle};
  const Eigen::Vector3i& tri = scene_.mesh().triangles[closest.triangle];
  switch (closest.feature) {
    case Feature::kFace:
      value.normal = scene_.mesh().normal(closest.triangle);
      break;
    case Feature::kEdge01:
      value.normal = edge_normals_[closest.triangle][0];
      break;
    case Feature::kEdge12:
      value.normal = edge_normals_[closest.triangle][1];
      break;
    case Feature::kEdge20:
      value.normal = edge_normals_[closest.triangle][2];
      break;
    case Feature::kVertex0:
      value.normal = vertex_normals_[tri[0]];
      break;
    case Feature::kVertex1:
      value.normal = vertex_normals_[tri[1]];
      break;
    case Feature::kVertex2:
      value.normal = vertex_normals_[tri[2]];
      break;
  }
  if ((point - closest.point).dot(value.normal) < 0) value.distance = -value.distance;
  return value;
}

std::optional<SignedDistance::Value> SignedDistance::operator()(const Eigen::Vector3f& point,
                                                                float max_distance) const {
  const auto closest = scene_.closest(point, max_distance);
  if (!closest) return std::nullopt;
  return signed_value(point, *closest);
}

std::optional<SignedDistance::Value> SignedDistance::operator()(const Eigen::Vector3f& point,
                                                                const Eigen::Vector3f& normal,
                                                                float min_cosine, float max_distance) const {
  const auto closest = scene_.closest_facing(point, max_distance, normal, min_cosine);
  if (!closest) return std::nullopt;
  return signed_value(point, *closest);
}

}  // namespace gantry
