#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"
#include "gantry/kinematics/chain.h"

namespace gantry {

/// What a body rides on. Its mesh is given in that frame.
enum class Carrier {
  kFrame,     ///< The fixed gantry: `base`.
  kSensor,    ///< Fixed too: `sensor`.
  kCarriage,  ///< Of one joint: in the base frame, as it stands when all joints are at zero.
  kPart       ///< The last stage: `part`.
};

/// Something that must not be hit. A closed mesh stands for a solid; an open one for its surface.
struct CollisionBody {
  std::string name;
  Carrier carrier = Carrier::kFrame;
  size_t joint = 0;  ///< Index of the joint whose carriage it rides on; kCarriage only.
  TriangleMesh mesh;
};

struct CollisionOptions {
  double clearance_mm = 5;  ///< Bodies that come as near as this count as colliding.
  /// How far each axis may be off the straight joint path (mm or rad), the axes being not perfectly in step:
  /// every distance is demanded to be larger by what this can do to it. Empty: zero for all.
  std::vector<double> path_deviation;
  /// A pair that comes this near to the limit is refused too: without it, the search would creep for ever
  /// along a path that just grazes the limit.
  double tolerance_mm = 0.05;
  /// Names of bodies that touch by design (a carriage and the guide that it runs on).
  std::vector<std::pair<std::string, std::string>> may_touch;
};

/// Where a path first comes too near.
struct Collision {
  std::string first, second;  ///< Names of the bodies.
  double at = 0;              ///< Along the path, 0 to 1.
  std::vector<double> q;      ///< Joints there, mm or rad.
  double clearance_mm = 0;    ///< Distance of the two there; 0 when they touch.
  /// What it must exceed: the clearance, room for axes out of step, and the tolerance. In the rare case that
  /// `clearance_mm` does exceed it, the pair grazes the limit for so long that the search has given up.
  double demanded_mm = 0;
};

/// The bodies of a cell and whether they meet when the joints move together in a straight line in joint
/// space. Nothing is missed between samples: conservative advancement (Mirtich, Impulse-based Dynamic
/// Simulation of Rigid Body Systems, 1996) steps only as far as the present distance of two bodies,
/// divided by a bound on how fast any point of the one can move against the other, proves to be free. The
/// bound: a prismatic joint moves points by its own travel; a revolute one by its angle times their largest
/// distance from its axis. Distances between meshes are FCL's, exact between triangles.
///
/// Pairs on the same carriage do not move against each other and are not checked, nor are two fixed bodies.
class CollisionModel {
 public:
  /// Throws InputError naming the body or option that cannot be right.
  CollisionModel(const Chain& chain, std::vector<CollisionBody> bodies, CollisionOptions options);

  /// The first place on the way from `q_from` to `q_to` at which two bodies are nearer than allowed; nothing
  /// when the whole path is free. Throws std::invalid_argument for a wrong number of joints or no numbers.
  std::optional<Collision> first_on_path(std::span<const double> q_from, std::span<const double> q_to) const;

  /// The smallest distance of any pair that is checked when the joints stand at q, whose `clearance_mm` may
  /// be larger than the limit; nothing when no pair is checked.
  std::optional<Collision> nearest_pair(std::span<const double> q) const;

  /// Names of all pairs that are checked.
  std::vector<std::pair<std::string, std::string>> pairs() const;

 private:
  class Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace gantry
