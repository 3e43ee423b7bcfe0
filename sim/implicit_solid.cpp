#include "implicit_solid.h"

#include <Eigen/Cholesky>
#include <array>
#include <vector>

namespace gantry {
namespace {

Eigen::Vector3d unit_gradient(const ImplicitSolid& solid, const Eigen::Vector3d& p) {
  constexpr double kStep = 1e-4;
  Eigen::Vector3d gradient;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
    gradient[k] = solid(p + step) - solid(p - step);
  }
  return gradient.normalized();
}

/// Where the surface crosses the segment: halved until only one piece of the surface is left (the value
/// bends at every edge of the solid), then linear.
Eigen::Vector3d crossing(const ImplicitSolid& solid, Eigen::Vector3d a, double value_a, Eigen::Vector3d b,
                         double value_b) {
  for (int i = 0; i < 6; ++i) {
    const Eigen::Vector3d middle = 0.5 * (a + b);
    const double value = solid(middle);
    if ((value < 0) == (value_a < 0)) {
      a = middle;
      value_a = value;
    } else {
      b = middle;
      value_b = value;
    }
  }
  return a + value_a / (value_a - value_b) * (b - a);
}

/// The least-squares meeting point of tangent planes, in coordinates from the cell's centre.
struct TangentPlanes {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  int count = 0;

  void add(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
    information += normal * normal.transpose();
    right += normal * normal.dot(point);
    sum += point;
    ++count;
  }
  /// Along what the planes leave open, the point stays at the mean of the crossings.
  Eigen::Vector3d meeting_point() const {
    constexpr double kPull = 1e-2;
    return (information + kPull * count * Eigen::Matrix3d::Identity()).ldlt().solve(right + kPull * sum);
  }
};

class Contouring {
 public:
  Contouring(const ImplicitSolid& solid, const Eigen::AlignedBox3d& box, double cell_mm)
      : solid_(solid), cell_(cell_mm) {
    // One empty cell around the box; the odd fraction keeps faces at round positions off the grid's nodes.
    origin_ = box.min() - Eigen::Vector3d::Constant(1.371 * cell_);
    for (int k = 0; k < 3; ++k) nodes_[k] = static_cast<int>(std::ceil(box.sizes()[k] / cell_)) + 4;
    stride_ = {1, static_cast<size_t>(nodes_[0]), static_cast<size_t>(nodes_[0]) * nodes_[1]};
    values_.resize(stride_[2] * nodes_[2]);
    for_each_node([&](const Eigen::Vector3i& n, size_t i) { values_[i] = solid_(position(n)); });
  }

  TriangleMesh mesh() {
    cell_vertex_.assign(values_.size(), -1);
    for_each_node([&](const Eigen::Vector3i& n, size_t i) {
      for (int axis = 0; axis < 3; ++axis) add_edge(n, i, axis);
    });
    TriangleMesh mesh;
    mesh.vertices.reserve(planes_.size());
    for (size_t v = 0; v < planes_.size(); ++v) {
      // Planes that have no common point (an edge break smaller than a cell) meet beside the surface, hence
      // the step back to it.
      const Eigen::Vector3d vertex = kept_in_cell(v, centres_[v] + planes_[v].meeting_point());
      mesh.vertices.push_back(
          kept_in_cell(v, vertex - solid_(vertex) * unit_gradient(solid_, vertex)).cast<float>());
    }
    for (const Quad& quad : quads_) add_triangles(quad, mesh);
    return mesh;
  }

 private:
  /// Counter-clockwise seen from outside.
  struct Quad {
    std::array<int, 4> vertices;
    Eigen::Vector3f normal;  ///< Of the solid where the grid edge in its middle crosses the surface.
  };

  template <typename Body>
  void for_each_node(const Body& body) const {
    size_t i = 0;
    for (int z = 0; z < nodes_[2]; ++z)
      for (int y = 0; y < nodes_[1]; ++y)
        for (int x = 0; x < nodes_[0]; ++x) body(Eigen::Vector3i(x, y, z), i++);
  }

  Eigen::Vector3d position(const Eigen::Vector3i& node) const {
    return origin_ + cell_ * node.cast<double>();
  }

  /// By a margin, so that no two vertices meet and no quad folds over.
  Eigen::Vector3d kept_in_cell(size_t v, const Eigen::Vector3d& point) const {
    const double reach = 0.49 * cell_;
    return centres_[v] + (point - centres_[v]).cwiseMax(-reach).cwiseMin(reach);
  }

  /// The vertex of the cell whose lowest corner is this node.
  int vertex_of(const Eigen::Vector3i& node, size_t i) {
    if (cell_vertex_[i] < 0) {
      cell_vertex_[i] = static_cast<int>(planes_.size());
      planes_.emplace_back();
      centres_.push_back(position(node) + Eigen::Vector3d::Constant(0.5 * cell_));
    }
    return cell_vertex_[i];
  }

  /// The edge from a node along an axis: where it crosses the surface, four cells meet in a quad.
  void add_edge(const Eigen::Vector3i& node, size_t i, int axis) {
    if (node[axis] + 1 >= nodes_[axis]) return;
    const size_t end = i + stride_[axis];
    if ((values_[i] < 0) == (values_[end] < 0)) return;
    const Eigen::Vector3d p = crossing(solid_, position(node), values_[i],
                                       position(node + Eigen::Vector3i::Unit(axis)), values_[end]);
    const Eigen::Vector3d normal = unit_gradient(solid_, p);
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    Quad quad;
    quad.normal = normal.cast<float>();
    static constexpr int kAround[4][2] = {{1, 1}, {0, 1}, {0, 0}, {1, 0}};  // counter-clockwise about +axis
    for (int k = 0; k < 4; ++k) {
      Eigen::Vector3i corner = node;
      corner[u] -= kAround[k][0];
      corner[v] -= kAround[k][1];
      const int vertex = vertex_of(corner, i - kAround[k][0] * stride_[u] - kAround[k][1] * stride_[v]);
      planes_[vertex].add(p - centres_[vertex], normal);
      quad.vertices[k] = vertex;
    }
    if (values_[i] >= 0) std::reverse(quad.vertices.begin(), quad.vertices.end());
    quads_.push_back(quad);
  }

  /// Splits a quad along the diagonal whose triangles face more like the surface.
  void add_triangles(const Quad& quad, TriangleMesh& mesh) const {
    const auto& q = quad.vertices;
    const auto agreement = [&](int a, int b, int c) {
      const Eigen::Vector3f& origin = mesh.vertices[a];
      const Eigen::Vector3f side = mesh.vertices[b] - origin, other = mesh.vertices[c] - origin;
      return side.cross(other).normalized().dot(quad.normal);
    };
    if (std::min(agreement(q[0], q[1], q[2]), agreement(q[0], q[2], q[3])) >=
        std::min(agreement(q[0], q[1], q[3]), agreement(q[1], q[2], q[3]))) {
      mesh.triangles.emplace_back(q[0], q[1], q[2]);
      mesh.triangles.emplace_back(q[0], q[2], q[3]);
    } else {
      mesh.triangles.emplace_back(q[0], q[1], q[3]);
      mesh.triangles.emplace_back(q[1], q[2], q[3]);
    }
  }

  const ImplicitSolid& solid_;
  double cell_;
  Eigen::Vector3d origin_;
  std::array<int, 3> nodes_;
  std::array<size_t, 3> stride_;
  std::vector<double> values_;    ///< At each node.
  std::vector<int> cell_vertex_;  ///< -1 where the surface does not pass.
  std::vector<TangentPlanes> planes_;
  std::vector<Eigen::Vector3d> centres_;
  std::vector<Quad> quads_;
};

}  // namespace

TriangleMesh polygonise(const ImplicitSolid& solid, const Eigen::AlignedBox3d& box, double cell_mm) {
  return Contouring(solid, box, cell_mm).mesh();
}

}  // namespace gantry
