#include "surface_search.h"

#include <bit>
#include <cmath>

namespace gantry::internal {
namespace {

/// By how much distances found in float are wrong at most, for lengths of one: some units in the last place.
constexpr float kRounding = 1.0f / (1 << 20);

struct Query {
  Query(const SurfaceTree& searched, const TriangleMesh& of, const Eigen::Vector3f& from, float reach,
        const Facing& counting)
      : tree(searched),
        mesh(of),
        point(from),
        max_distance(reach),
        facing(counting),
        best_squared(static_cast<double>(reach) * reach) {
    saw(reach);
  }

  const SurfaceTree& tree;
  const TriangleMesh& mesh;
  const Eigen::Vector3f point;
  const float max_distance;
  const Facing facing;

  double best_squared;  ///< Of what has been measured in double.
  SurfaceIndex::Closest best{};
  bool found = false;

  bool trust_lanes = true;  ///< Else every triangle that comes into question is measured at once.
  float nearest, margin;    ///< In float, of what has been seen; by how much that is wrong at most.
  float limit;              ///< What is further, squared, cannot be the closest.
  static constexpr int kMostCandidates = 32;
  int candidates[kMostCandidates];
  float squared[kMostCandidates];
  int count = 0;

  void saw(float distance) {
    nearest = distance;
    margin = kRounding * (distance + tree.longest_side);
    limit = reach() * reach();
  }
  float reach() const { return nearest + 2 * margin; }

  void measure(int t) {
    const Eigen::Vector3i& tri = mesh.triangles[static_cast<size_t>(t)];
    const Eigen::Vector3d p = point.cast<double>();
    TriangleFeature feature;
    const Eigen::Vector3d q =
        closest_on_triangle(p, mesh.vertices[tri[0]].cast<double>(), mesh.vertices[tri[1]].cast<double>(),
                            mesh.vertices[tri[2]].cast<double>(), feature);
    const double d = (q - p).squaredNorm();
    // Of equally close triangles the first, so that the answer does not depend on the order of the visit.
    if (!(d < best_squared || (d == best_squared && (!found || t < best.triangle)))) return;
    best_squared = d;
    best = {q.cast<float>(), 0, t, feature, (p - q).cast<float>()};
    found = true;
  }
  float measured() const { return static_cast<float>(std::sqrt(best_squared)); }
  void measure_candidates() {
    const float most = limit;
    for (int k = 0; k < count; ++k)
      if (squared[k] <= most) measure(candidates[k]);
    count = 0;
    if (found && measured() < nearest) saw(measured());
  }
  /// Whether float took something to be nearer than it was: then what is farther has been passed by.
  bool misled() const { return found ? measured() > reach() : nearest < max_distance; }
  void add_candidate(int t, float d) {
    if (count == kMostCandidates) measure_candidates();
    candidates[count] = t;
    squared[count++] = d;
  }
};

GANTRY_INLINE Lanes3 in_all_lanes(const Eigen::Vector3f& p) {
  const Lanes zero{};
  return {zero + p.x(), zero + p.y(), zero + p.z()};
}

GANTRY_INLINE Lanes squared_distance_to_segment(const Lanes3& from_start, const Lanes3& along,
                                                const Lanes& inverse) {
  const Lanes zero{}, one = zero + 1;
  const Lanes t = minimum(maximum(dot(from_start, along) * inverse, zero), one);
  const Lanes3 d = {from_start.x - t * along.x, from_start.y - t * along.y, from_start.z - t * along.z};
  return dot(d, d);
}

/// Squared distances to eight triangles: to the plane where the foot lies inside all sides, else to the
/// nearest side. Never more than rounding too far, for slivers either; near a very acute corner it can be
/// too near.
GANTRY_INLINE Lanes squared_distances(const TriangleBlock& b, const Lanes3& p) {
  const Lanes zero{};
  const Lanes3 ap = subtract(p, b.a), bp = subtract(ap, b.ab), bc = subtract(b.ac, b.ab);
  const Lanes sides = minimum(minimum(squared_distance_to_segment(ap, b.ab, b.inverse_ab),
                                      squared_distance_to_segment(ap, b.ac, b.inverse_ac)),
                              squared_distance_to_segment(bp, bc, b.inverse_bc));
  const Lanes inside =
      minimum(minimum(dot(cross(b.ab, ap), b.n), dot(cross(ap, b.ac), b.n)), dot(cross(bc, bp), b.n));
  const Lanes height = dot(ap, b.n);
  return inside > zero ? height * height : sides;
}

GANTRY_INLINE Lanes squared_distances(const Lanes3& low, const Lanes3& high, const Lanes3& p) {
  const Lanes zero{};
  const Lanes3 d = {maximum(maximum(low.x - p.x, p.x - high.x), zero),
                    maximum(maximum(low.y - p.y, p.y - high.y), zero),
                    maximum(maximum(low.z - p.z, p.z - high.z), zero)};
  return dot(d, d);
}

struct Entry {
  float squared;
  int child;
};

/// Puts an entry into stack[bottom, size), the nearest on top.
GANTRY_INLINE void insert(Entry* stack, int bottom, int& size, Entry entry) {
  int at = size++;
  for (; at > bottom && stack[at - 1].squared < entry.squared; --at) stack[at] = stack[at - 1];
  stack[at] = entry;
}

GANTRY_INLINE void look_at(const TriangleBlock& block, const Lanes3& p, Query& query) {
  const Lanes zero{};
  const Lanes d = squared_distances(block, p);
  LaneMask close = d <= zero + query.limit;
  if (query.facing.asked)
    close &= dot(block.n, in_all_lanes(query.facing.direction)) >= zero + query.facing.min_cosine;
  for (unsigned bits = bits_of(close); bits != 0; bits &= bits - 1) {
    const int k = std::countr_zero(bits);
    const int t = block.triangle[k];
    if (t < 0 || d[k] > query.limit) continue;
    query.add_candidate(t, d[k]);
    if (!query.trust_lanes) {
      query.measure_candidates();
    } else if (d[k] < query.nearest * query.nearest) {
      query.saw(std::sqrt(d[k]));
    }
  }
}

GANTRY_FOR_EACH_CPU void search_block(Query& query, int block) {
  look_at(query.tree.blocks[static_cast<size_t>(block)], in_all_lanes(query.point), query);
}

/// Looks at all of the tree but the block that was looked at before.
GANTRY_FOR_EACH_CPU void search_tree(Query& query, int known) {
  Entry stack[kLanes * SurfaceTree::kMostLevels];
  int size = 0;
  stack[size++] = {0, 0};
  const Lanes3 p = in_all_lanes(query.point);
  while (size > 0) {
    const Entry entry = stack[--size];
    if (entry.squared > query.limit) continue;
    if (entry.child < 0) {
      if (~entry.child != known) look_at(query.tree.blocks[static_cast<size_t>(~entry.child)], p, query);
      continue;
    }
    const TreeNode& node = query.tree.nodes[static_cast<size_t>(entry.child)];
    const Lanes d = squared_distances(node.low, node.high, p);
    const int bottom = size;
    for (unsigned bits = bits_of(d <= Lanes{} + query.limit); bits != 0; bits &= bits - 1) {
      const int k = std::countr_zero(bits);
      insert(stack, bottom, size, {d[k], node.child[k]});
    }
  }
}

GANTRY_FOR_EACH_CPU void search_surroundings(Query& query, const Surroundings& surroundings, int known) {
  Entry stack[Surroundings::kMostBlocks];
  int size = 0;
  const Lanes3 p = in_all_lanes(query.point);
  for (int group = 0; group < surroundings.groups(); ++group) {
    const Lanes d = squared_distances(surroundings.low(group), surroundings.high(group), p);
    for (unsigned bits = bits_of(d <= Lanes{} + query.limit); bits != 0; bits &= bits - 1) {
      const int k = std::countr_zero(bits);
      const int block = surroundings.blocks(group)[k];
      if (block != known) insert(stack, 0, size, {d[k], block});
    }
  }
  while (size > 0) {
    const Entry entry = stack[--size];
    if (entry.squared > query.limit) break;
    look_at(query.tree.blocks[static_cast<size_t>(entry.child)], p, query);
  }
}

}  // namespace

bool Surroundings::serve(const Eigen::Vector3f& point, float reach) {
  const bool inside = (point - centre_).norm() * (1 + kRounding) + reach < radius_ * (1 - kRounding);
  uses_ += inside;
  return inside;
}

GANTRY_FOR_EACH_CPU bool Surroundings::collect(float radius) {
  int stack[kLanes * SurfaceTree::kMostLevels];
  int size = 0;
  stack[size++] = 0;
  const Lanes3 p = in_all_lanes(centre_);
  count_ = 0;
  while (size > 0) {
    const TreeNode& node = tree->nodes[static_cast<size_t>(stack[--size])];
    const LaneMask near = squared_distances(node.low, node.high, p) <= Lanes{} + radius * radius;
    for (unsigned bits = bits_of(near); bits != 0; bits &= bits - 1) {
      const int k = std::countr_zero(bits);
      if (node.child[k] >= 0) {
        stack[size++] = node.child[k];
        continue;
      }
      if (count_ == kMostBlocks) return false;
      const int group = count_ / kLanes, lane = count_ % kLanes;
      set_lane(low_[group], lane, node.low.x[k], node.low.y[k], node.low.z[k]);
      set_lane(high_[group], lane, node.high.x[k], node.high.y[k], node.high.z[k]);
      block_[count_++] = ~node.child[k];
    }
  }
  for (int k = count_; k % kLanes != 0; ++k) {  // the last group's other lanes
    constexpr float kFar = SurfaceTree::kFarOutside_mm;
    set_lane(low_[k / kLanes], k % kLanes, kFar, kFar, kFar);
    set_lane(high_[k / kLanes], k % kLanes, kFar, kFar, kFar);
    block_[k] = block_[0];
  }
  return true;
}

void Surroundings::gather(const Eigen::Vector3f& point, float reach) {
  if (pause_ > 0) {
    --pause_;
    return;
  }
  const bool worthwhile = radius_ == 0 || uses_ >= kWorthwhile;
  const float radius = std::max(wanted_radius_, 2 * reach);
  centre_ = point;
  radius_ = 0;
  uses_ = 0;
  if (worthwhile && collect(radius)) {
    radius_ = radius;
    wanted_radius_ = count_ < kMostBlocks / 3 ? 1.5f * radius : radius;
  } else {
    wanted_radius_ = 0.7f * radius;
    if (!worthwhile || wanted_radius_ < 2 * reach) pause_ = kPause;
  }
}

std::optional<SurfaceIndex::Closest> search(const SurfaceTree& tree, const TriangleMesh& mesh,
                                            const Eigen::Vector3f& point, float max_distance,
                                            const Facing& facing, int near_triangle, Surroundings* near) {
  if (!point.allFinite() || !(max_distance >= 0)) return std::nullopt;
  Query query(tree, mesh, point, max_distance, facing);
  if (near && near->tree != &tree) {
    *near = {};
    near->tree = &tree;
  }
  int known = near ? near->nearest_block : -1;
  if (near_triangle >= 0 && static_cast<size_t>(near_triangle) < mesh.triangles.size())
    known = tree.block_of_triangle[static_cast<size_t>(near_triangle)];
  if (known >= 0) search_block(query, known);
  if (near && known >= 0 && !near->serve(point, query.reach())) near->gather(point, query.reach());
  if (near && near->serve(point, query.reach())) {
    search_surroundings(query, *near, known);
  } else {
    search_tree(query, known);
  }
  query.measure_candidates();
  if (query.misled()) {
    query.trust_lanes = false;
    query.saw(query.found ? query.measured() : query.max_distance);
    search_tree(query, -1);
  }
  if (!query.found) return std::nullopt;
  if (near) near->nearest_block = tree.block_of_triangle[static_cast<size_t>(query.best.triangle)];
  query.best.distance = query.measured();
  return query.best;
}

}  // namespace gantry::internal
