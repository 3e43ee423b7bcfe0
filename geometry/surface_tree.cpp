#include "surface_tree.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace gantry::internal {
namespace {

constexpr float kFarOutside_mm = 1e18f;  ///< Its square still fits a float.
constexpr int kBins = 16;
/// Subtrees of more triangles are built as tasks of their own.
constexpr size_t kTask = 20000;
/// From this level on splits are made at the median, which bounds the depth whatever the mesh is like.
constexpr int kMedianLevel = 24;

struct Primitive {
  Eigen::AlignedBox3f box;
  int triangle;
  Eigen::Vector3f centre() const { return 0.5f * (box.min() + box.max()); }
};
using Range = std::span<Primitive>;

float half_area(const Eigen::AlignedBox3f& box) {
  const Eigen::Vector3f s = box.sizes();
  return s.x() * s.y() + s.y() * s.z() + s.z() * s.x();
}

Eigen::AlignedBox3f bounds_of(Range range) {
  Eigen::AlignedBox3f bounds;
  for (const Primitive& p : range) bounds.extend(p.box);
  return bounds;
}

/// What it costs to look at so many triangles: blocks are looked at whole.
float blocks_for(size_t triangles) {
  return static_cast<float>((triangles + kLanes - 1) / kLanes);
}

size_t split_at_median(Range range, int axis) {
  const auto middle = range.begin() + static_cast<std::ptrdiff_t>(range.size() / 2);
  std::nth_element(range.begin(), middle, range.end(), [axis](const Primitive& p, const Primitive& q) {
    return std::pair(p.centre()[axis], p.triangle) < std::pair(q.centre()[axis], q.triangle);
  });
  return range.size() / 2;
}

/// Rearranges the range in two parts and returns the size of the first.
size_t split(Range range, bool at_median) {
  Eigen::AlignedBox3f centres;
  for (const Primitive& p : range) centres.extend(p.centre());
  int axis = 0;
  const float extent = centres.sizes().maxCoeff(&axis);
  const float to_bin = kBins / extent;
  if (at_median || !(extent > 0) || !std::isfinite(to_bin)) return split_at_median(range, axis);
  const auto bin_of = [&](const Primitive& p) {
    return std::min(static_cast<int>((p.centre()[axis] - centres.min()[axis]) * to_bin), kBins - 1);
  };
  std::array<Eigen::AlignedBox3f, kBins> boxes;
  std::array<size_t, kBins> counts{};
  for (const Primitive& p : range) {
    const auto bin = static_cast<size_t>(bin_of(p));
    boxes[bin].extend(p.box);
    ++counts[bin];
  }
  std::array<float, kBins> cost_from{};  // of all bins from this one on
  Eigen::AlignedBox3f box;
  size_t count = 0;
  for (size_t bin = kBins - 1; bin > 0; --bin) {
    box.extend(boxes[bin]);
    count += counts[bin];
    cost_from[bin] = count > 0 ? blocks_for(count) * half_area(box) : 0;
  }
  box.setEmpty();
  count = 0;
  float least = std::numeric_limits<float>::infinity();
  int best = 0;
  for (size_t bin = 1; bin < kBins; ++bin) {
    box.extend(boxes[bin - 1]);
    count += counts[bin - 1];
    if (count == 0 || count == range.size()) continue;
    const float cost = blocks_for(count) * half_area(box) + cost_from[bin];
    if (cost >= least) continue;
    least = cost;
    best = static_cast<int>(bin);
  }
  if (best == 0) return split_at_median(range, axis);
  const auto second =
      std::partition(range.begin(), range.end(), [&](const Primitive& p) { return bin_of(p) < best; });
  return static_cast<size_t>(second - range.begin());
}

struct Part {
  Range range;
  Eigen::AlignedBox3f bounds;
};

/// Up to eight parts, by splitting the largest of them again and again.
std::vector<Part> split_in_eight(Range range, int level) {
  std::vector<Part> parts{{range, bounds_of(range)}};
  while (parts.size() < kLanes) {
    Part* largest = nullptr;
    for (Part& part : parts)
      if (part.range.size() > kLanes && (!largest || half_area(part.bounds) > half_area(largest->bounds)))
        largest = &part;
    if (!largest) break;
    const Range whole = largest->range;
    const size_t first = split(whole, level >= kMedianLevel);
    *largest = {whole.first(first), bounds_of(whole.first(first))};
    parts.push_back({whole.subspan(first), bounds_of(whole.subspan(first))});
  }
  return parts;
}

void set(Lanes3& lanes, int lane, const Eigen::Vector3f& v) {
  lanes.x[lane] = v.x();
  lanes.y[lane] = v.y();
  lanes.z[lane] = v.z();
}

TriangleBlock block_of(const TriangleMesh& mesh, Range range) {
  TriangleBlock block{};
  for (int k = 0; k < kLanes; ++k) {
    block.triangle[k] = -1;
    set(block.a, k, Eigen::Vector3f::Constant(kFarOutside_mm));
    if (static_cast<size_t>(k) >= range.size()) continue;
    block.triangle[k] = range[static_cast<size_t>(k)].triangle;
    const Eigen::Vector3i& tri = mesh.triangles[static_cast<size_t>(block.triangle[k])];
    const Eigen::Vector3f& a = mesh.vertices[tri[0]];
    const Eigen::Vector3f ab = mesh.vertices[tri[1]] - a, ac = mesh.vertices[tri[2]] - a;
    set(block.a, k, a);
    set(block.ab, k, ab);
    set(block.ac, k, ac);
    set(block.n, k, mesh.normal(static_cast<size_t>(block.triangle[k])));
    // A side that is too short to be inverted is as good as a point.
    const auto inverse = [](float squared) { return squared > 1e-30f ? 1 / squared : 0; };
    block.inverse_ab[k] = inverse(ab.squaredNorm());
    block.inverse_ac[k] = inverse(ac.squaredNorm());
    block.inverse_bc[k] = inverse((ac - ab).squaredNorm());
  }
  return block;
}

struct Subtree {
  std::vector<TreeNode> nodes;
  std::vector<TriangleBlock> blocks;
};

/// Appends a node over the range, and all that is below it.
void append(const TriangleMesh& mesh, Range range, int level, Subtree& to) {
  const size_t here = to.nodes.size();
  TreeNode node{};
  const Eigen::Vector3f outside = Eigen::Vector3f::Constant(kFarOutside_mm);
  for (int k = 0; k < kLanes; ++k) {
    set(node.low, k, outside);
    set(node.high, k, outside);
    node.child[k] = ~0;
  }
  to.nodes.push_back(node);
  const std::vector<Part> parts = split_in_eight(range, level);
  for (size_t k = 0; k < parts.size(); ++k) {
    set(node.low, static_cast<int>(k), parts[k].bounds.min());
    set(node.high, static_cast<int>(k), parts[k].bounds.max());
  }
  const auto child = [&](size_t k, Subtree& in) {
    if (parts[k].range.size() > kLanes) {
      append(mesh, parts[k].range, level + 1, in);
    } else {
      in.blocks.push_back(block_of(mesh, parts[k].range));
    }
  };
  if (range.size() > kTask) {
    std::vector<Subtree> subtrees(parts.size());
    tbb::parallel_for(size_t{0}, parts.size(), [&](size_t k) { child(k, subtrees[k]); });
    for (size_t k = 0; k < parts.size(); ++k) {
      Subtree& sub = subtrees[k];
      const int first_node = static_cast<int>(to.nodes.size()),
                first_block = static_cast<int>(to.blocks.size());
      node.child[k] = sub.nodes.empty() ? ~first_block : first_node;
      for (TreeNode& n : sub.nodes)
        for (int& c : n.child) c += c >= 0 ? first_node : -first_block;
      to.nodes.insert(to.nodes.end(), sub.nodes.begin(), sub.nodes.end());
      to.blocks.insert(to.blocks.end(), sub.blocks.begin(), sub.blocks.end());
      sub = {};
    }
  } else {
    for (size_t k = 0; k < parts.size(); ++k) {
      const bool leaf = parts[k].range.size() <= kLanes;
      node.child[k] = leaf ? ~static_cast<int>(to.blocks.size()) : static_cast<int>(to.nodes.size());
      child(k, to);
    }
  }
  to.nodes[here] = node;
}

}  // namespace

SurfaceTree::SurfaceTree(const TriangleMesh& mesh) {
  std::vector<Primitive> primitives;
  primitives.reserve(mesh.triangles.size());
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.normal(t).isZero()) continue;
    Primitive p{{}, static_cast<int>(t)};
    for (const int corner : mesh.triangles[t]) p.box.extend(mesh.vertices[corner]);
    longest_side = std::max(longest_side, p.box.diagonal().norm());
    primitives.push_back(p);
  }
  triangles = primitives.size();
  if (primitives.empty()) return;
  Subtree all;
  append(mesh, primitives, 0, all);
  nodes = std::move(all.nodes);
  blocks = std::move(all.blocks);
}

}  // namespace gantry::internal
