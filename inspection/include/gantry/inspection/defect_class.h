#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>

namespace gantry {

/// What a region of the part's surface is that is not simply good. How each is told:
///
///  - kMissingFeature: most of what was measured there continues a neighbouring CAD face (plane, cylinder,
///    ...) across a face that was not seen, or lies out of tolerance by half at least: a hole, pocket or slot
///    that was not made, filled with material; a boss or rib of which only the ground was found.
///  - kPartDefect: form. The surface is there but lies elsewhere: both sides of a wall are displaced together
///    (a dent pressed through a sheet, a bend), or one side where the other is not known, gently or inwards.
///  - kExtraMaterial: to one side only, outwards, where the wall's other side was seen to be good, or
///  standing
///    out locally: higher than a tenth of its width and over less than half of its face. A burr, weld
///    spatter.
///  - kMissingMaterial: to one side only, inwards, and the wall's other side was seen to be good, or it goes
///    across a sharp edge, or has steep flanks (a broken edge, a gouge, a hole that is not in the CAD model).
///  - kRegistrationResidue: scans contradict each other there, a rigid motion of one of them explains it, and
///    the other scans find the surface good (see residue.h). Neither good nor bad: it must be measured again.
///  - kFixture: the holder, of a mesh or a scan of the empty holder. Not judged; listed.
///  - kNoData: CAD surface that no judged point covers. Not judged; listed, never passed silently.
enum class DefectClass {
  kPartDefect,
  kMissingFeature,
  kMissingMaterial,
  kExtraMaterial,
  kRegistrationResidue,
  kFixture,
  kNoData
};
std::string_view to_string(DefectClass defect_class);  ///< "part defect", "missing feature", "no data", ...

/// A connected piece of surface that was not judged: of the CAD model and not seen (kNoData), or of the
/// fixture (kFixture). Frame of the CAD model.
struct UnjudgedRegion {
  DefectClass kind = DefectClass::kNoData;
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d extent_mm = Eigen::Vector3d::Zero();  ///< Size of its bounding box along x, y, z.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();     ///< Mean, unit; zero where normals cancel.
  double area_mm2 = 0;
  std::string face;        ///< kNoData: the CAD face that has most of it: "plane 3" ...
  std::string face_words;  ///< ... and what that is.
  double face_share = 0;   ///< kNoData: how much of that face is not seen here: 1, it is missing altogether.
  bool behind_fixture = false;  ///< kNoData: the fixture touches or covers at least half of it.
  size_t points = 0;            ///< kFixture: of the cloud.
};

}  // namespace gantry
