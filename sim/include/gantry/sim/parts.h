#pragma once

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

// Parts on which registration is tried beside the bracket (bracket.h). Each is hard in its own way. All are
// watertight meshes in mm of 100k to 300k triangles, centred near the origin, made anew in about a second:
// keep what you get. Edges are broken by 0.4 to 0.6 mm as on machined parts.

/// A forged lever of 160 x 35 x 18 mm (x, y, z): a slender cranked arm, tapered in width and height, with
/// drafted sides, between two drilled bosses of 22 and 15 mm; a groove in its top. Without any symmetry.
/// Hard because most scans see little surface and long lever arms magnify rotations.
TriangleMesh make_slim_lever();

/// A milled block of 110 x 80 x 50 mm (x, y, z) with a step, a pocket, one large chamfer and two holes.
/// Hard because planes dominate: an overlap of one or two planes lets scans slide. All features together
/// leave one pose only.
TriangleMesh make_prismatic_block();

/// What breaks the symmetry of the turned part.
enum class RevolvedFeature {
  kNone,  ///< Nothing: the rotation about z cannot be observed.
  kFlat,  ///< One milled flat, 25 mm wide, 2 mm deep, over the largest diameter, on the side of +x.
  kBumps  ///< Three round bumps, 1.5 mm high, 10 mm wide, on the largest diameter at 0, 100 and 220 degrees.
};

/// A turned part about the z axis, 80 mm in diameter and 110 mm long: shaft with relief groove, shoulder,
/// collar with groove, cone. Meshed as rings of 720 vertices, so that a turn is seen by 0.4 um at most.
TriangleMesh make_revolved_part(RevolvedFeature feature);

/// A plate of 120 x 90 x 3 mm (x, y, z) with five holes of 6 to 24 mm. Hard because its faces constrain
/// three of six motions only, and because a scan of one face fits the other face 3 mm away just as well.
TriangleMesh make_plate();

}  // namespace gantry
