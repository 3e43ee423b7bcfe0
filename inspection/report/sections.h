#pragma once

#include <Eigen/Core>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"
#include "report/measured_surface.h"

namespace gantry::report {

/// A piece of the outline in which a plane meets the CAD surface, in the plane's coordinates (mm).
struct SectionLine {
  std::vector<Eigen::Vector2f> points;  ///< The first one again at the end when `closed`.
  bool closed = false;
};

/// A cut through the part across one of the CAD model's axes, and what was measured near it.
struct Section {
  struct Measured {
    Eigen::Vector2f nominal;   ///< On the CAD outline, or where it was measured, for material beyond it.
    Eigen::Vector2f outwards;  ///< In the plane, out of the material; shorter than 1 where the face leans.
    float deviation_mm;
    bool on_cad;
  };

  char letter = 'A';
  int axis = 0;  ///< 0, 1, 2: the plane x, y or z = offset_mm.
  float offset_mm = 0;
  int through = 0;    ///< The defect that the plane cuts, at its peak or near it; 0: none.
  float slab_mm = 0;  ///< What was measured within this of the plane belongs to it.
  std::vector<SectionLine> outline;
  std::vector<Measured> measured;

  /// Axes that run right and up when one looks from the positive side.
  int right() const { return axis == 0 ? 1 : 0; }
  int up() const { return axis == 2 ? 1 : 2; }
  /// y = offset looked at from +y would have x run to the left: it is looked at from the negative side.
  bool from_positive_side() const { return axis != 1; }
  Eigen::Vector2f in_plane(const Eigen::Vector3f& p) const { return {p[right()], p[up()]}; }
  Eigen::Vector3f in_space(const Eigen::Vector2f& p) const {
    Eigen::Vector3f q;
    q[axis] = offset_mm;
    q[right()] = p.x();
    q[up()] = p.y();
    return q;
  }
};

/// Of the measured places on the CAD surface in a section (mm); NaN without any.
struct SectionStatistics {
  size_t count = 0;
  double mean = 0, min = 0, max = 0;
};
SectionStatistics section_statistics(const Section& section);

/// The outline of the CAD surface in the plane of `section`. Of a watertight mesh all lines are closed.
std::vector<SectionLine> outline(const TriangleMesh& cad, const Section& section);

/// Three cuts, one across each axis: through the largest defects that a cut across that axis shows, else
/// through the part's middle. Without those that miss the part.
std::vector<Section> sections(const TriangleMesh& cad, const MeasuredSurface& measured,
                              const std::vector<Defect>& defects);

}  // namespace gantry::report
