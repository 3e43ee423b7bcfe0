#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "gantry/inspection/cad_faces.h"

namespace gantry::internal {

/// A planar piece of a mesh: triangles that lie in one plane and hang together.
struct Flat {
  struct Border {
    int flat;
    double length_mm;
    bool smooth;  ///< Bent by less than kSmooth_rad.
  };
  std::vector<int> triangles;
  std::vector<Eigen::Vector3d> corners;  ///< Each position once.
  Eigen::Vector3d normal, centroid;
  double area_mm2 = 0;
  std::vector<Border> borders;  ///< One for each neighbour, the longest first.
  double open_mm = 0;           ///< Length of border without a neighbour.
};

/// Takes the mesh apart into flats, by falling area of their largest triangle. Triangles without area belong
/// to none. `adjacent` as adjacent_triangles() gives it.
std::vector<Flat> find_flats(const TriangleMesh& mesh, const std::vector<std::array<int, 3>>& adjacent,
                             double tolerance_mm);

/// The surface of a kind (no plane) through all corners of the flats; nothing when there is none that is well
/// determined. Whether they lie on it is for lies_on() to say.
std::optional<CadSurface> fit_surface(SurfaceKind kind, const std::vector<Flat>& flats,
                                      std::span<const int> members);

/// All corners lie on the surface, the flat faces along its normal, and is no further from it in its middle
/// than a facet between edges of a smooth surface can be.
bool lies_on(const CadSurface& surface, const Flat& flat, double tolerance_mm);

}  // namespace gantry::internal
