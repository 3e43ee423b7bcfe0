#include "gantry/acquisition/collision_settings.h"

#include <algorithm>
#include <set>

#include "gantry/acquisition/cell.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/kinematics/chain_file.h"
#include "gantry/kinematics/collision_shapes.h"

namespace gantry {
namespace {

constexpr StrictYaml::Range kSize_mm{0.01, 1e5};

Simplification read_simplification(StrictYaml& yaml) {
  if (!yaml.has("simplified")) return Simplification::kNone;
  const std::string word = yaml.choice("simplified", {"none", "convex_hull", "bounding_box"});
  if (word == "convex_hull") return Simplification::kConvexHull;
  return word == "bounding_box" ? Simplification::kBoundingBox : Simplification::kNone;
}

CollisionShape read_shape(StrictYaml yaml) {
  using Kind = CollisionShape::Kind;
  CollisionShape shape;
  const std::string kind = yaml.choice("kind", {"box", "cylinder", "sphere", "mesh"});
  if (kind == "box") {
    shape.kind = Kind::kBox;
    shape.size_mm = yaml.vector3("size_mm");
    if (!(shape.size_mm.minCoeff() >= kSize_mm.min && shape.size_mm.maxCoeff() <= kSize_mm.max))
      yaml.fail("size_mm", "expected three sizes from 0.01 to 100000 mm");
  } else if (kind == "mesh") {
    shape.kind = Kind::kMesh;
    shape.file = yaml.path("file");
    shape.simplified = read_simplification(yaml);
  } else {
    shape.kind = kind == "cylinder" ? Kind::kCylinder : Kind::kSphere;
    shape.radius_mm = yaml.number("radius_mm", kSize_mm);
    if (shape.kind == Kind::kCylinder) shape.height_mm = yaml.number("height_mm", kSize_mm);
  }
  const Eigen::Vector3d rpy_deg = yaml.vector3_or("rotation_rpy_deg", Eigen::Vector3d::Zero());
  const Eigen::Vector3d position_mm = yaml.vector3_or("position_mm", Eigen::Vector3d::Zero());
  shape.body_from_shape = pose_from_position_rpy(position_mm, rpy_deg * (std::acos(-1.0) / 180));
  yaml.finish();
  return shape;
}

CollisionBodySettings read_body(StrictYaml yaml, const Chain& chain) {
  CollisionBodySettings body;
  body.name = yaml.text("name");
  std::vector<std::string> carriers{"frame", "sensor", "part"};
  for (const Joint& joint : chain.joints) {
    if (std::count(carriers.begin(), carriers.end(), joint.name))
      yaml.fail("rides_on", "an axis is called '" + joint.name + "' too; give the axis another name");
    carriers.push_back(joint.name);
  }
  const std::string carrier = yaml.choice("rides_on", carriers);
  if (carrier == "sensor") {
    body.carrier = Carrier::kSensor;
  } else if (carrier == "part") {
    body.carrier = Carrier::kPart;
  } else if (carrier != "frame") {
    body.carrier = Carrier::kCarriage;
    const auto joint = std::find_if(chain.joints.begin(), chain.joints.end(),
                                    [&](const Joint& each) { return each.name == carrier; });
    body.joint = static_cast<size_t>(joint - chain.joints.begin());
  }
  for (StrictYaml& shape : yaml.maps("shapes")) body.shapes.push_back(read_shape(std::move(shape)));
  yaml.finish();
  return body;
}

std::vector<double> read_deviation(StrictYaml yaml, const Chain& chain) {
  std::vector<double> deviation;
  for (const Joint& joint : chain.joints)
    deviation.push_back(joint.kind == JointKind::kPrismatic
                            ? yaml.number_or(joint.name + "_mm", 0, {0, 100})
                            : yaml.angle_deg_or(joint.name + "_deg", 0, {0, 30}));
  yaml.finish();
  return deviation;
}

TriangleMesh simplified(const TriangleMesh& mesh, Simplification how) {
  if (how == Simplification::kConvexHull) return convex_hull(mesh);
  return how == Simplification::kBoundingBox ? bounding_box_mesh(mesh) : mesh;
}

TriangleMesh mesh_of(const CollisionShape& shape) {
  switch (shape.kind) {
    case CollisionShape::Kind::kBox:
      return box_mesh(shape.size_mm);
    case CollisionShape::Kind::kCylinder:
      return cylinder_mesh(shape.radius_mm, shape.height_mm);
    case CollisionShape::Kind::kSphere:
      return sphere_mesh(shape.radius_mm);
    case CollisionShape::Kind::kMesh:
      return simplified(read_mesh(shape.file), shape.simplified);
  }
  return {};
}

}  // namespace

CellCollision read_collision(StrictYaml yaml, const Chain& chain) {
  CellCollision collision;
  collision.options.clearance_mm = yaml.number("clearance_mm", {0, 1000});
  if (auto deviation = yaml.map_if_present("path_deviation"))
    collision.options.path_deviation = read_deviation(std::move(*deviation), chain);
  std::set<std::string> names{kPartBody, kFixtureBody};
  for (StrictYaml& entry : yaml.maps("bodies")) {
    CollisionBodySettings body = read_body(entry, chain);
    if (!names.insert(body.name).second)
      entry.fail("name", "there is a body '" + body.name +
                             "' already; 'part' and 'fixture' are the CAD model and the cell's fixture");
    collision.bodies.push_back(std::move(body));
  }
  if (yaml.has("may_touch")) {
    for (StrictYaml& pair : yaml.maps("may_touch", 0)) {
      const auto name = [&](const char* key) {
        const std::string text = pair.text(key);
        if (!names.contains(text)) pair.fail(key, "there is no body '" + text + "'");
        return text;
      };
      const std::string first = name("first"), second = name("second");
      if (first == second) pair.fail("second", "a body cannot touch itself");
      collision.options.may_touch.emplace_back(first, second);
      pair.finish();
    }
  }
  for (const auto& [key, simplification] :
       {std::pair{kPartBody, &collision.part}, {kFixtureBody, &collision.fixture}}) {
    auto map = yaml.map_if_present(key);
    if (!map) continue;
    *simplification = read_simplification(*map);
    map->finish();
  }
  yaml.finish();
  return collision;
}

CollisionModel make_collision_model(const Cell& cell, const TriangleMesh* part, const TriangleMesh* fixture) {
  const CellCollision& settings = cell.collision.value();
  std::vector<CollisionBody> bodies;
  for (const CollisionBodySettings& body : settings.bodies) {
    CollisionBody placed{body.name, body.carrier, body.joint, {}};
    for (const CollisionShape& shape : body.shapes)
      placed.mesh = merged(placed.mesh, transformed(mesh_of(shape), shape.body_from_shape));
    bodies.push_back(std::move(placed));
  }
  if (part) bodies.push_back({kPartBody, Carrier::kPart, 0, simplified(*part, settings.part)});
  if (fixture) bodies.push_back({kFixtureBody, Carrier::kPart, 0, simplified(*fixture, settings.fixture)});
  CollisionOptions options = settings.options;
  std::erase_if(options.may_touch, [&](const auto& pair) {
    const auto absent = [&](const std::string& name) {
      return (name == kPartBody && !part) || (name == kFixtureBody && !fixture);
    };
    return absent(pair.first) || absent(pair.second);
  });
  return {cell.chain, std::move(bodies), std::move(options)};
}

}  // namespace gantry
