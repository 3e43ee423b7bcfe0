#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <string_view>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

enum class SurfaceKind { kPlane, kCylinder, kCone, kSphere, kFreeform };
std::string_view to_string(SurfaceKind kind);  ///< "plane", "cylinder", "cone", "sphere", "freeform"

/// The unbounded surface that a CAD face is a piece of. mm, frame of the mesh.
struct CadSurface {
  SurfaceKind kind = SurfaceKind::kFreeform;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< Of a plane; on a cylinder's axis; apex; centre.
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();   ///< A plane's normal, out of the material; a cone's axis
                                                    ///< from its apex; a cylinder's axis.
  double radius_mm = 0;                             ///< Of a cylinder or sphere.
  double half_angle_rad = 0;                        ///< Of a cone.
  bool hollow = false;  ///< The material lies outside of the cylinder, cone or sphere: a hole.

  /// Distance of a point, positive on the side where no material is. NaN for a freeform surface.
  double distance(const Eigen::Vector3d& p) const;
  /// Unit normal at the point of the surface closest to p, out of the material. Zero where there is none.
  Eigen::Vector3d normal_at(const Eigen::Vector3d& p) const;
};

/// A smooth face of a CAD model.
struct CadFace {
  std::string name;   ///< "plane 3": stable for one CAD model, numbered by falling area within its kind.
  std::string words;  ///< "hole of 8.0 mm along z at x 20.0, y 10.0"
  CadSurface surface;
  double turn_rad = 0;        ///< How far a cylinder or cone goes round its axis: 2 pi if all the way.
  Eigen::Vector3d centre_mm;  ///< Centroid of its area.
  Eigen::Vector3d normal;     ///< Mean, unit; zero where normals cancel (a full cylinder).
  double area_mm2 = 0;
  Eigen::AlignedBox3d box;
  std::vector<int> triangles;
  std::vector<int> neighbours;  ///< Faces that it shares an edge with, rising.
};

struct CadFaces {
  std::vector<CadFace> faces;         ///< By kind, then by falling area, then by position.
  std::vector<int> face_of_triangle;  ///< Index into `faces`; of every triangle.
};

/// Takes a CAD mesh apart into the smooth faces that it was tessellated from. Facets are joined to flat
/// pieces; pieces that meet at less than 25 degrees to the largest cylinder, cone or sphere that all their
/// corners lie on to within 0.001 mm (tessellations put corners onto the surface), as in Attene et al.,
/// "Hierarchical mesh segmentation based on fitting primitives", 2006, but exact, as CAD is. So a bend is
/// told from the flanges that run into it without an edge. What is left is freeform, one face for each smooth
/// piece. Of a surface that is no CAD (a scan) everything is freeform. The same for any number of threads.
CadFaces segment_faces(const TriangleMesh& mesh);

}  // namespace gantry
