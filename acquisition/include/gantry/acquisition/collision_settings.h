#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/kinematics/collision.h"

namespace gantry {

struct Cell;

/// How a mesh from a file becomes coarse.
enum class Simplification { kNone, kConvexHull, kBoundingBox };

/// One of the shapes of which a body is made.
struct CollisionShape {
  enum class Kind { kBox, kCylinder, kSphere, kMesh };
  Kind kind = Kind::kBox;
  Eigen::Vector3d size_mm = Eigen::Vector3d::Zero();  ///< Of a box.
  double radius_mm = 0, height_mm = 0;                ///< Of a cylinder (along z) or a sphere.
  std::filesystem::path file;                         ///< Of a mesh, mm.
  Simplification simplified = Simplification::kNone;  ///< Of a mesh.
  Pose body_from_shape = Pose::Identity();
};

struct CollisionBodySettings {
  std::string name;
  Carrier carrier = Carrier::kFrame;
  size_t joint = 0;
  std::vector<CollisionShape> shapes;
};

/// The `collision:` section of CELL.yaml.
struct CellCollision {
  std::vector<CollisionBodySettings> bodies;
  CollisionOptions options;
  Simplification part = Simplification::kNone;     ///< Of the CAD model given with a plan.
  Simplification fixture = Simplification::kNone;  ///< Of the cell's fixture.
};

/// Names of the two bodies that are there without being listed.
inline constexpr const char* kPartBody = "part";
inline constexpr const char* kFixtureBody = "fixture";

/// Reads the section; the format is in docs/files.md. Opens no mesh. Throws InputError with file, line, key.
CellCollision read_collision(StrictYaml yaml, const Chain& chain);

/// The bodies of the cell, with the part (its CAD mesh) and the fixture where they are given. Throws
/// InputError for a mesh file that cannot be read. The cell must have a collision section.
CollisionModel make_collision_model(const Cell& cell, const TriangleMesh* part, const TriangleMesh* fixture);

}  // namespace gantry
