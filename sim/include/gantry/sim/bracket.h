#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Defects that the demo part can be given. All lengths in mm; positions are named on the flat pattern
/// in bracket.cpp, their truth in the part frame comes from bracket_truth().
struct BracketDefects {
  double dent_depth_mm = 0;    ///< Round dent, 8 mm wide, in the back flange, pressed from behind.
  bool missing_hole = false;   ///< One of the four 8 mm holes of the base was not drilled.
  double burr_height_mm = 0;   ///< Ridge, 2 mm wide and 12 mm long, along one long edge of the base.
  double flange_bend_rad = 0;  ///< The front flange leans outwards by this angle.
};

/// The defects that examples/parts/bracket_defective.stl carries: 0.4 mm, missing, 0.6 mm, 1 degree.
BracketDefects seeded_defects();

/// The demo part: sheet metal of 2 mm bent to a U of 120 x 80 x 60 mm (x, y, z) with a bead as a rib, a
/// back flange 60 mm high and a front flange 35 mm high, seven holes. Watertight, about 47k triangles;
/// the base's underside lies in z = 0, the part spans x 0..120 and y -40..40.
///
/// The sheet is meshed flat, as a grid with an O-grid around each hole, and then folded, the way the
/// real part is made; both faces and the cut edges come out joined.
TriangleMesh make_bracket(const BracketDefects& defects = {});

/// What stands beside a defective part as JSON: where each defect is and how large.
struct DefectTruth {
  std::string kind;           ///< "dent", "missing_hole", "burr", "bent_flange".
  Eigen::Vector3d centre_mm;  ///< Centroid of the part's surface that deviates by more than the threshold.
  Eigen::Vector3d extent_mm;  ///< Size of that surface's bounding box, along x, y, z.
  double depth_mm;            ///< Largest deviation from the CAD surface.
  double area_mm2;            ///< Of that surface, both faces of the sheet.
};

/// Truth by sampling the displacement that made each defect, on both faces of the sheet. Only surface
/// whose deviation exceeds `threshold_mm` counts, so that the figures compare with what an inspection
/// at that tolerance should report.
std::vector<DefectTruth> bracket_truth(const BracketDefects& defects, double threshold_mm);

/// The holder that carries the bracket on the stage, in the part frame: a post with a plate below, and
/// a clamp screw on top of the base. It is not in the CAD model.
TriangleMesh make_holder();

}  // namespace gantry
