#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>

#include "collision/motion_bound.h"
#include "collision/solid.h"
#include "gantry/foundation/error.h"
#include "gantry/kinematics/collision.h"

namespace gantry {
namespace {

void require(bool ok, const std::string& what) {
  if (!ok) throw InputError("collision: " + what);
}

void validate(const TriangleMesh& mesh, const std::string& name) {
  require(!mesh.triangles.empty(), "body '" + name + "' has no triangles");
  for (const Eigen::Vector3f& vertex : mesh.vertices)
    require(vertex.allFinite(), "body '" + name + "' has a vertex that is no number");
  const int count = static_cast<int>(mesh.vertices.size());
  for (const Eigen::Vector3i& t : mesh.triangles)
    require(t.minCoeff() >= 0 && t.maxCoeff() < count, "body '" + name + "' has a triangle without vertices");
}

}  // namespace

class CollisionModel::Impl {
 public:
  Impl(const Chain& chain, std::vector<CollisionBody> bodies, CollisionOptions options)
      : joints_(chain.joints), options_(std::move(options)) {
    require(options_.clearance_mm >= 0 && std::isfinite(options_.clearance_mm),
            "clearance_mm must not be negative");
    require(options_.tolerance_mm > 0 && std::isfinite(options_.tolerance_mm),
            "tolerance_mm must be positive");
    require(options_.path_deviation.empty() || options_.path_deviation.size() == joints_.size(),
            "path_deviation needs one value for each joint");
    for (const double deviation : options_.path_deviation)
      require(deviation >= 0 && std::isfinite(deviation), "path_deviation must not be negative");
    std::set<std::string> names;
    for (CollisionBody& body : bodies) {
      require(!body.name.empty() && names.insert(body.name).second,
              "two bodies are called '" + body.name + "'");
      validate(body.mesh, body.name);
      require(body.carrier != Carrier::kCarriage || body.joint < joints_.size(),
              "body '" + body.name + "' rides on a joint that is not there");
      bodies_.push_back(place(chain, body));
    }
    for (const auto& [a, b] : options_.may_touch)
      for (const std::string& name : {a, b})
        require(names.contains(name), "may_touch: there is no body '" + name + "'");
    for (size_t i = 0; i < bodies_.size(); ++i)
      for (size_t j = i + 1; j < bodies_.size(); ++j) add_pair(i, j);
  }

  std::optional<Collision> first_on_path(std::span<const double> q_from, std::span<const double> q_to) const {
    require_joints(q_from);
    require_joints(q_to);
    std::optional<Collision> first;
    double until = 1;
    for (const Pair& pair : pairs_) {
      const auto found = advance(pair, q_from, q_to, until);
      if (!found) continue;
      if (first && found->at >= first->at) continue;
      first = found;
      until = found->at;
    }
    return first;
  }

  std::optional<Collision> nearest_pair(std::span<const double> q) const {
    require_joints(q);
    std::optional<Collision> nearest;
    for (const Pair& pair : pairs_) {
      const Pose pose = moved(pair, q, q, 0);
      const double distance = solid_distance(pair, pose);
      if (!nearest || distance < nearest->clearance_mm)
        nearest = collision(pair, q, q, 0, distance, options_.clearance_mm);
    }
    return nearest;
  }

  std::vector<std::pair<std::string, std::string>> pairs() const {
    std::vector<std::pair<std::string, std::string>> names;
    for (const Pair& pair : pairs_) names.emplace_back(bodies_[pair.low].name, bodies_[pair.high].name);
    return names;
  }

 private:
  struct Body {
    std::string name;
    size_t joints_below;  ///< So many joints move it.
    Solid solid;          ///< In the base frame, all joints at zero.
  };
  /// `high` rides on at least one joint more than `low`; the joints between move it against `low`.
  struct Pair {
    size_t low, high;
  };

  Body place(const Chain& chain, const CollisionBody& body) const {
    Pose base_from_body = Pose::Identity();
    size_t joints_below = 0;
    if (body.carrier == Carrier::kSensor) base_from_body = chain.base_from_sensor;
    if (body.carrier == Carrier::kCarriage) joints_below = body.joint + 1;
    if (body.carrier == Carrier::kPart) {
      base_from_body = chain.base_from_part_at_zero;
      joints_below = joints_.size();
    }
    return {body.name, joints_below, Solid(transformed(body.mesh, base_from_body))};
  }

  void add_pair(size_t i, size_t j) {
    const Body &a = bodies_[i], &b = bodies_[j];
    if (a.joints_below == b.joints_below) return;
    for (const auto& [first, second] : options_.may_touch)
      if ((first == a.name && second == b.name) || (first == b.name && second == a.name)) return;
    pairs_.push_back(a.joints_below < b.joints_below ? Pair{i, j} : Pair{j, i});
  }

  void require_joints(std::span<const double> q) const {
    if (q.size() != joints_.size() ||
        !std::all_of(q.begin(), q.end(), [](double v) { return std::isfinite(v); }))
      throw std::invalid_argument("CollisionModel: one number for each joint is needed");
  }

  /// The part of a span of joint values that is between the pair's bodies.
  template <typename T>
  std::span<const T> between(const Pair& pair, std::span<const T> all) const {
    const size_t begin = bodies_[pair.low].joints_below;
    return all.empty() ? all : all.subspan(begin, bodies_[pair.high].joints_below - begin);
  }

  /// low_from_high, where both stand at zero.
  Pose moved(const Pair& pair, std::span<const double> q_from, std::span<const double> q_to,
             double at) const {
    Pose pose = Pose::Identity();
    for (size_t j = bodies_[pair.low].joints_below; j < bodies_[pair.high].joints_below; ++j)
      pose = pose * pose_exp(joints_[j].twist() * (q_from[j] + at * (q_to[j] - q_from[j])));
    return pose;
  }

  double solid_distance(const Pair& pair, const Pose& pose) const {
    const Solid &low = bodies_[pair.low].solid, &high = bodies_[pair.high].solid;
    const double distance = surface_distance(low, high, pose);
    return distance > 0 && one_holds_other(low, high, pose) ? 0 : distance;
  }

  Collision collision(const Pair& pair, std::span<const double> q_from, std::span<const double> q_to,
                      double at, double clearance_mm, double demanded_mm) const {
    Collision result{bodies_[pair.high].name, bodies_[pair.low].name, at, {}, clearance_mm, demanded_mm};
    for (size_t j = 0; j < q_from.size(); ++j) result.q.push_back(q_from[j] + at * (q_to[j] - q_from[j]));
    return result;
  }

  std::optional<Collision> advance(const Pair& pair, std::span<const double> q_from,
                                   std::span<const double> q_to, double until) const;

  std::vector<Joint> joints_;
  CollisionOptions options_;
  std::vector<Body> bodies_;
  std::vector<Pair> pairs_;
};

std::optional<Collision> CollisionModel::Impl::advance(const Pair& pair, std::span<const double> q_from,
                                                       std::span<const double> q_to, double until) const {
  constexpr int kRefinements = 3, kMostTries = 20;
  constexpr int kMostSteps = 50'000;  // a path that takes more of them grazes the limit for metres
  const Solid &low = bodies_[pair.low].solid, &high = bodies_[pair.high].solid;
  const auto joints = between(pair, std::span<const Joint>(joints_));
  const auto from = between(pair, q_from), to = between(pair, q_to);
  const auto deviation = between(pair, std::span<const double>(options_.path_deviation));
  const auto bound = [&](double begin, double end) {
    return bound_motion(joints, from, to, deviation, begin, end, high.corners());
  };

  double at = 0;
  for (int step = 0;; ++step) {
    const Pose pose = moved(pair, q_from, q_to, at);
    // How far it is free from here on, as a function of a distance that is known to be there: over the whole
    // rest first; where that does not suffice, over shorter stretches, whose bounds are tighter.
    const MotionBound rest = bound(at, until);
    const auto free_until = [&](double distance) {
      MotionBound present = rest;
      double end = until, reached = at;
      for (int refinements = 0, k = 0; refinements < kRefinements && k < kMostTries; ++k) {
        const double spare_mm = distance - options_.clearance_mm - present.deviation_mm;
        if (spare_mm > 0) {
          const double stretch = present.speed_mm > 0 ? spare_mm / present.speed_mm : 2;
          reached = std::max(reached, std::min(end, at + stretch));
          if (reached >= end) break;
          end = std::min(until, at + 2 * stretch);
          ++refinements;
        } else {
          end = at + (end - at) / 8;
        }
        present = bound(at, end);
      }
      return reached;
    };
    // Bounding spheres are quick, and often enough.
    const double apart_mm = (low.centre() - pose * high.centre()).norm() - low.radius() - high.radius();
    if (free_until(apart_mm) >= until) return std::nullopt;

    const double distance = step == 0 ? solid_distance(pair, pose) : surface_distance(low, high, pose);
    const double demanded_mm = options_.clearance_mm + bound(at, at).deviation_mm + options_.tolerance_mm;
    if (distance <= demanded_mm) return collision(pair, q_from, q_to, at, distance, demanded_mm);
    const double next = free_until(distance);
    if (next >= until) return std::nullopt;
    if (!(next > at) || step == kMostSteps)
      return collision(pair, q_from, q_to, at, distance, demanded_mm);  // free, but not proved to stay so
    at = next;
  }
}

CollisionModel::CollisionModel(const Chain& chain, std::vector<CollisionBody> bodies,
                               CollisionOptions options)
    : impl_(std::make_shared<const Impl>(chain, std::move(bodies), std::move(options))) {}

std::optional<Collision> CollisionModel::first_on_path(std::span<const double> q_from,
                                                       std::span<const double> q_to) const {
  return impl_->first_on_path(q_from, q_to);
}

std::optional<Collision> CollisionModel::nearest_pair(std::span<const double> q) const {
  return impl_->nearest_pair(q);
}

std::vector<std::pair<std::string, std::string>> CollisionModel::pairs() const {
  return impl_->pairs();
}

}  // namespace gantry
