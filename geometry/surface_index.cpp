#include "gantry/geometry/surface_index.h"

#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>

#include "gantry/foundation/error.h"
#include "surface_tree.h"

namespace gantry {
namespace {

using namespace internal;

/// By how much distances found in float are wrong at most, for lengths of one: some units in the last place.
constexpr float kRounding = 1.0f / (1 << 20);

struct Query {
  Query(const SurfaceTree& searched, const TriangleMesh& of, const Eigen::Vector3f& from, float reach)
      : tree(searched),
        mesh(of),
        point(from),
        max_distance(reach),
        best_squared(static_cast<double>(reach) * reach) {
    saw(reach);
  }

  const SurfaceTree& tree;
  const TriangleMesh& mesh;
  const Eigen::Vector3f point;
  const float max_distance;
  bool facing = false;  ///< Whether only triangles count whose normal has so large a cosine to the direction.
  Eigen::Vector3f direction = Eigen::Vector3f::Zero();
  float min_cosine = 0;

  double best_squared;  ///< Of what has been measured in double.
  SurfaceIndex::Closest best{};
  bool found = false;

  bool trust_lanes = true;  ///< Else every triangle that comes into question is measured at once.
  float nearest, margin;    ///< In float, of what has been seen; by how much that is wrong at most.
  static constexpr int kMostCandidates = 32;
  int candidates[kMostCandidates];
  float squared[kMostCandidates];
  int count = 0;

  void saw(float distance) {
    nearest = distance;
    margin = kRounding * (distance + tree.longest_side);
  }
  /// What is further, squared, cannot be the closest.
  float limit() const { return (nearest + 2 * margin) * (nearest + 2 * margin); }

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
    const float most = limit();
    for (int k = 0; k < count; ++k)
      if (squared[k] <= most) measure(candidates[k]);
    count = 0;
    if (found && measured() < nearest) saw(measured());
  }
  /// Whether float took something to be nearer than it was: then what is farther has been passed by.
  bool misled() const { return found ? measured() > nearest + 2 * margin : nearest < max_distance; }
  void add_candidate(int t, float d) {
    if (count == kMostCandidates) measure_candidates();
    candidates[count] = t;
    squared[count++] = d;
  }
};

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

GANTRY_INLINE Lanes squared_distances(const TreeNode& n, const Lanes3& p) {
  const Lanes zero{};
  const Lanes3 d = {maximum(maximum(n.low.x - p.x, p.x - n.high.x), zero),
                    maximum(maximum(n.low.y - p.y, p.y - n.high.y), zero),
                    maximum(maximum(n.low.z - p.z, p.z - n.high.z), zero)};
  return dot(d, d);
}

GANTRY_INLINE void look_at(const TriangleBlock& block, const Lanes3& p, Query& query) {
  const Lanes zero{};
  const Lanes d = squared_distances(block, p);
  LaneMask close = d <= zero + query.limit();
  if (query.facing) {
    const Lanes3 direction = {zero + query.direction.x(), zero + query.direction.y(),
                              zero + query.direction.z()};
    close &= dot(block.n, direction) >= zero + query.min_cosine;
  }
  for (unsigned bits = bits_of(close); bits != 0; bits &= bits - 1) {
    const int k = std::countr_zero(bits);
    const int t = block.triangle[k];
    if (t < 0 || d[k] > query.limit()) continue;
    query.add_candidate(t, d[k]);
    if (!query.trust_lanes) {
      query.measure_candidates();
    } else if (d[k] < query.nearest * query.nearest) {
      query.saw(std::sqrt(d[k]));
    }
  }
}

/// `first`: a block that is looked at before all others; negative: none.
GANTRY_FOR_EACH_CPU void search(Query& query, int first) {
  struct Entry {
    float squared;
    int child;
  };
  Entry stack[kLanes * SurfaceTree::kMostLevels];
  int size = 0;
  stack[size++] = {0, 0};
  const Lanes zero{};
  const Lanes3 p = {zero + query.point.x(), zero + query.point.y(), zero + query.point.z()};
  if (first >= 0) look_at(query.tree.blocks[static_cast<size_t>(first)], p, query);
  while (size > 0) {
    const Entry entry = stack[--size];
    if (entry.squared > query.limit()) continue;
    if (entry.child < 0) {
      if (~entry.child != first) look_at(query.tree.blocks[static_cast<size_t>(~entry.child)], p, query);
      continue;
    }
    const TreeNode& node = query.tree.nodes[static_cast<size_t>(entry.child)];
    const Lanes d = squared_distances(node, p);
    const int bottom = size;
    for (unsigned bits = bits_of(d <= zero + query.limit()); bits != 0; bits &= bits - 1) {
      const int k = std::countr_zero(bits);
      int at = size++;  // the nearest on top
      for (; at > bottom && stack[at - 1].squared < d[k]; --at) stack[at] = stack[at - 1];
      stack[at] = {d[k], node.child[k]};
    }
  }
}

}  // namespace

struct SurfaceIndex::Impl {
  explicit Impl(TriangleMesh given)
      : mesh(std::move(given)), normals(normals_of(mesh)), tree(mesh, normals) {}
  TriangleMesh mesh;
  std::vector<Eigen::Vector3f> normals;
  SurfaceTree tree;

  static std::vector<Eigen::Vector3f> normals_of(const TriangleMesh& mesh) {
    std::vector<Eigen::Vector3f> normals(mesh.triangles.size());
    tbb::parallel_for(size_t{0}, normals.size(), [&](size_t t) { normals[t] = mesh.normal(t); });
    return normals;
  }

  std::optional<Closest> answer(Query& query, int near_triangle) const {
    if (!query.point.allFinite() || !(query.max_distance >= 0)) return std::nullopt;
    const bool guessed = near_triangle >= 0 && static_cast<size_t>(near_triangle) < mesh.triangles.size();
    const int first = guessed ? tree.block_of_triangle[static_cast<size_t>(near_triangle)] : -1;
    search(query, first);
    query.measure_candidates();
    if (query.misled()) {
      query.trust_lanes = false;
      query.saw(query.found ? query.measured() : query.max_distance);
      search(query, first);
    }
    if (!query.found) return std::nullopt;
    query.best.distance = query.measured();
    return query.best;
  }
};

SurfaceIndex::SurfaceIndex(TriangleMesh mesh) : impl_(std::make_unique<Impl>(std::move(mesh))) {
  if (impl_->tree.triangles == 0)
    throw InputError("a mesh without a triangle that has an area cannot be measured to");
}

SurfaceIndex::~SurfaceIndex() = default;
SurfaceIndex::SurfaceIndex(SurfaceIndex&&) noexcept = default;
SurfaceIndex& SurfaceIndex::operator=(SurfaceIndex&&) noexcept = default;

const TriangleMesh& SurfaceIndex::mesh() const {
  return impl_->mesh;
}
const std::vector<Eigen::Vector3f>& SurfaceIndex::normals() const {
  return impl_->normals;
}

std::optional<SurfaceIndex::Closest> SurfaceIndex::closest(const Eigen::Vector3f& point, float max_distance,
                                                           int near_triangle) const {
  Query query(impl_->tree, impl_->mesh, point, max_distance);
  return impl_->answer(query, near_triangle);
}

std::optional<SurfaceIndex::Closest> SurfaceIndex::closest_facing(const Eigen::Vector3f& point,
                                                                  float max_distance,
                                                                  const Eigen::Vector3f& direction,
                                                                  float min_cosine, int near_triangle) const {
  Query query(impl_->tree, impl_->mesh, point, max_distance);
  query.facing = true;
  query.direction = direction;
  query.min_cosine = min_cosine;
  return impl_->answer(query, near_triangle);
}

}  // namespace gantry
