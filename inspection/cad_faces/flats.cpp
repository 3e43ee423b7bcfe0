#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>

#include "alignment/tessellation.h"
#include "cad_faces/primitive_fit.h"

namespace gantry::internal {
namespace {

void finish(Flat& flat, const TriangleMesh& mesh) {
  flat.normal.setZero();
  flat.centroid.setZero();
  for (const int t : flat.triangles) {
    const double area = mesh.area(static_cast<size_t>(t));
    flat.area_mm2 += area;
    flat.normal += area * mesh.normal(static_cast<size_t>(t)).cast<double>();
    for (const int v : mesh.triangles[t]) {
      flat.corners.push_back(mesh.vertices[v].cast<double>());
      flat.centroid += area / 3 * flat.corners.back();
    }
  }
  flat.normal.normalize();
  flat.centroid /= flat.area_mm2;
  const auto key = [](const Eigen::Vector3d& p) { return std::make_tuple(p.x(), p.y(), p.z()); };
  std::sort(flat.corners.begin(), flat.corners.end(),
            [&](const auto& a, const auto& b) { return key(a) < key(b); });
  flat.corners.erase(std::unique(flat.corners.begin(), flat.corners.end()), flat.corners.end());
}

}  // namespace

std::vector<Flat> find_flats(const TriangleMesh& mesh, const std::vector<std::array<int, 3>>& adjacent,
                             double tolerance_mm) {
  const size_t n = mesh.triangles.size();
  std::vector<double> area(n);
  std::vector<int> order(n), flat_of(n, -1);
  for (size_t t = 0; t < n; ++t) area[t] = mesh.area(t);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return area[a] > area[b]; });

  const double smooth = std::cos(kSmooth_rad);
  std::vector<Flat> flats;
  for (const int seed : order) {
    const Eigen::Vector3d normal = mesh.normal(static_cast<size_t>(seed)).cast<double>();
    if (flat_of[seed] >= 0 || !(area[seed] > 0) || normal.isZero()) continue;
    const Eigen::Vector3d origin = mesh.vertices[mesh.triangles[seed][0]].cast<double>();
    const auto id = static_cast<int>(flats.size());
    Flat flat;
    flat.triangles.push_back(seed);
    flat_of[seed] = id;
    for (size_t k = 0; k < flat.triangles.size(); ++k)
      for (const int other : adjacent[flat.triangles[k]]) {
        if (other < 0 || flat_of[other] >= 0 || !(area[other] > 0)) continue;
        if (mesh.normal(static_cast<size_t>(other)).cast<double>().dot(normal) < smooth) continue;
        bool inside = true;
        for (const int v : mesh.triangles[other])
          inside = inside && std::abs(normal.dot(mesh.vertices[v].cast<double>() - origin)) <= tolerance_mm;
        if (!inside) continue;
        flat_of[other] = id;
        flat.triangles.push_back(other);
      }
    finish(flat, mesh);
    flats.push_back(std::move(flat));
  }

  for (size_t f = 0; f < flats.size(); ++f) {
    Flat& flat = flats[f];
    std::map<int, Flat::Border> borders;
    for (const int t : flat.triangles)
      for (int k = 0; k < 3; ++k) {
        const int other = adjacent[t][k] < 0 ? -1 : flat_of[adjacent[t][k]];
        if (other == static_cast<int>(f)) continue;
        const Eigen::Vector3i& corners = mesh.triangles[t];
        const double length = (mesh.vertices[corners[(k + 1) % 3]] - mesh.vertices[corners[k]]).norm();
        if (other < 0) {
          flat.open_mm += length;
          continue;
        }
        const bool bent =
            mesh.normal(static_cast<size_t>(t)).dot(mesh.normal(static_cast<size_t>(adjacent[t][k]))) <
            smooth;
        auto& border = borders.try_emplace(other, Flat::Border{other, 0, true}).first->second;
        border.length_mm += length;
        border.smooth = border.smooth && !bent;
      }
    for (const auto& [other, border] : borders) flat.borders.push_back(border);
    std::stable_sort(flat.borders.begin(), flat.borders.end(),
                     [](const auto& a, const auto& b) { return a.length_mm > b.length_mm; });
  }
  return flats;
}

}  // namespace gantry::internal
