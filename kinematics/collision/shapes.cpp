#include <cmath>
#include <map>
#include <numbers>

#include "gantry/foundation/error.h"
#include "gantry/kinematics/collision_shapes.h"

namespace gantry {
namespace {

constexpr int kCylinderSides = 32;
constexpr int kSphereSubdivisions = 2;  ///< Of an icosahedron: 320 triangles.

void require_positive(double value, const char* what) {
  if (!(value > 0) || !std::isfinite(value))
    throw InputError(std::string("collision shape: ") + what + " must be positive");
}

/// The sphere's mesh with vertices on the unit sphere.
TriangleMesh unit_icosphere() {
  const float g = static_cast<float>(std::numbers::phi);
  TriangleMesh mesh;
  mesh.vertices = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  for (auto& vertex : mesh.vertices) vertex.normalize();
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int k = 0; k < kSphereSubdivisions; ++k) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [found, added] =
          middles.try_emplace(std::minmax(a, b), static_cast<int>(mesh.vertices.size()));
      if (added)
        mesh.vertices.push_back(
            (mesh.vertices[static_cast<size_t>(a)] + mesh.vertices[static_cast<size_t>(b)]).normalized());
      return found->second;
    };
    std::vector<Eigen::Vector3i> finer;
    for (const Eigen::Vector3i& t : mesh.triangles) {
      const int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

}  // namespace

TriangleMesh box_mesh(const Eigen::Vector3d& size_mm) {
  for (int k = 0; k < 3; ++k) require_positive(size_mm[k], "each size of a box");
  TriangleMesh mesh;
  const Eigen::Vector3f half = (0.5 * size_mm).cast<float>();
  for (int corner = 0; corner < 8; ++corner)
    mesh.vertices.push_back({corner & 1 ? half.x() : -half.x(), corner & 2 ? half.y() : -half.y(),
                             corner & 4 ? half.z() : -half.z()});
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

TriangleMesh cylinder_mesh(double radius_mm, double height_mm) {
  require_positive(radius_mm, "the radius of a cylinder");
  require_positive(height_mm, "the height of a cylinder");
  const double outer = radius_mm / std::cos(std::numbers::pi / kCylinderSides);
  const float half = static_cast<float>(0.5 * height_mm);
  TriangleMesh mesh;
  for (int k = 0; k < kCylinderSides; ++k) {
    const double angle = 2 * std::numbers::pi * k / kCylinderSides;
    const float x = static_cast<float>(outer * std::cos(angle)),
                y = static_cast<float>(outer * std::sin(angle));
    mesh.vertices.push_back({x, y, -half});
    mesh.vertices.push_back({x, y, half});
  }
  const int bottom = 2 * kCylinderSides, top = bottom + 1;
  mesh.vertices.push_back({0, 0, -half});
  mesh.vertices.push_back({0, 0, half});
  for (int k = 0; k < kCylinderSides; ++k) {
    const int a = 2 * k, b = 2 * ((k + 1) % kCylinderSides);
    mesh.triangles.insert(mesh.triangles.end(),
                          {{a, b, b + 1}, {a, b + 1, a + 1}, {bottom, b, a}, {top, a + 1, b + 1}});
  }
  return mesh;
}

TriangleMesh sphere_mesh(double radius_mm) {
  require_positive(radius_mm, "the radius of a sphere");
  static const TriangleMesh unit = unit_icosphere();
  double inscribed = 1;  // of the mesh: the distance of its nearest face from the centre
  for (size_t t = 0; t < unit.triangles.size(); ++t)
    inscribed = std::min(inscribed, static_cast<double>(std::abs(unit.normal(t).dot(
                                        unit.vertices[static_cast<size_t>(unit.triangles[t][0])]))));
  TriangleMesh mesh = unit;
  for (auto& vertex : mesh.vertices) vertex *= static_cast<float>(radius_mm / inscribed);
  return mesh;
}

TriangleMesh bounding_box_mesh(const TriangleMesh& mesh) {
  const Eigen::AlignedBox3f bounds = mesh.bounds();
  TriangleMesh box = box_mesh(bounds.sizes().cast<double>());
  for (auto& vertex : box.vertices) vertex += bounds.center();
  return box;
}

}  // namespace gantry
