#include "surface_tree.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

namespace gantry::internal {
namespace {

constexpr size_t kBins = 16;
/// Subtrees of more triangles are built as tasks of their own.
constexpr size_t kTask = 20000;
/// From this level on splits are made at the median, which bounds the depth whatever the mesh is like.
constexpr int kMedianLevel = 24;

/// A box in four floats a corner, for the sake of SSE; the last ones mean nothing.
struct Box {
  Eigen::Array4f low = Eigen::Array4f::Constant(std::numeric_limits<float>::infinity()), high = -low;

  void extend(const Eigen::Array4f& point) {
    low = low.min(point);
    high = high.max(point);
  }
  void extend(const Box& other) {
    low = low.min(other.low);
    high = high.max(other.high);
  }
  bool empty() const { return low[0] > high[0]; }
  float half_area() const {
    const Eigen::Array4f s = high - low;
    return s[0] * s[1] + s[1] * s[2] + s[2] * s[0];
  }
};

struct Primitive {
  Box box;
  int triangle = -1;
  Eigen::Array4f twice_centre() const { return box.low + box.high; }
};
using Range = std::span<Primitive>;

/// Primitives that become one subtree.
struct Part {
  Range range;
  Box bounds, centres;  ///< Of the primitives, and of twice their centres.

  static Part of(Range range) {
    Part part{range, {}, {}};
    for (const Primitive& p : range) {
      part.bounds.extend(p.box);
      part.centres.extend(p.twice_centre());
    }
    return part;
  }
};

/// What it costs to look at so many triangles: blocks are looked at whole.
float blocks_for(size_t triangles) {
  return static_cast<float>((triangles + kLanes - 1) / kLanes);
}

std::pair<Part, Part> split_at_median(const Part& part, int axis) {
  const size_t half = part.range.size() / 2;
  std::nth_element(part.range.begin(), part.range.begin() + static_cast<std::ptrdiff_t>(half),
                   part.range.end(), [axis](const Primitive& p, const Primitive& q) {
                     return std::pair(p.twice_centre()[axis], p.triangle) <
                            std::pair(q.twice_centre()[axis], q.triangle);
                   });
  return {Part::of(part.range.first(half)), Part::of(part.range.subspan(half))};
}

std::pair<Part, Part> split(const Part& part, bool at_median) {
  const Eigen::Array3f sizes = (part.centres.high - part.centres.low).head<3>();
  Eigen::Index axis = 0;
  const float extent = sizes.maxCoeff(&axis);
  const float to_bin = kBins / extent;
  if (at_median || !(extent > 0) || !std::isfinite(extent) || !std::isfinite(to_bin))
    return split_at_median(part, static_cast<int>(axis));

  const float first = part.centres.low[axis];
  const auto bin_of = [&](const Primitive& p) {
    const float centre = p.box.low[axis] + p.box.high[axis];
    return std::min(static_cast<size_t>((centre - first) * to_bin), kBins - 1);
  };
  std::array<Box, kBins> boxes, centres;
  std::array<size_t, kBins> counts{};
  for (const Primitive& p : part.range) {
    const size_t bin = bin_of(p);
    boxes[bin].extend(p.box);
    centres[bin].extend(p.twice_centre());
    ++counts[bin];
  }
  std::array<float, kBins> cost_from{};  // of all bins from this one on
  Box box;
  size_t count = 0;
  for (size_t bin = kBins - 1; bin > 0; --bin) {
    box.extend(boxes[bin]);
    count += counts[bin];
    cost_from[bin] = count > 0 ? blocks_for(count) * box.half_area() : 0;
  }
  box = {};
  count = 0;
  float least = std::numeric_limits<float>::infinity();
  size_t best = 0;
  for (size_t bin = 1; bin < kBins; ++bin) {
    box.extend(boxes[bin - 1]);
    count += counts[bin - 1];
    if (count == 0 || count == part.range.size()) continue;
    const float cost = blocks_for(count) * box.half_area() + cost_from[bin];
    if (cost >= least) continue;
    least = cost;
    best = bin;
  }
  if (best == 0) return split_at_median(part, static_cast<int>(axis));
  const auto second = std::partition(part.range.begin(), part.range.end(),
                                     [&](const Primitive& p) { return bin_of(p) < best; });
  const auto size = static_cast<size_t>(second - part.range.begin());
  std::pair<Part, Part> halves{{part.range.first(size), {}, {}}, {part.range.subspan(size), {}, {}}};
  for (size_t bin = 0; bin < kBins; ++bin) {
    Part& half = bin < best ? halves.first : halves.second;
    half.bounds.extend(boxes[bin]);
    half.centres.extend(centres[bin]);
  }
  return halves;
}

/// Up to eight parts, by splitting the largest of them again and again.
std::vector<Part> split_in_eight(const Part& whole, int level) {
  std::vector<Part> parts{whole};
  while (parts.size() < kLanes) {
    Part* largest = nullptr;
    for (Part& part : parts)
      if (part.range.size() > kLanes && (!largest || part.bounds.half_area() > largest->bounds.half_area()))
        largest = &part;
    if (!largest) break;
    auto [first, second] = split(*largest, level >= kMedianLevel);
    *largest = first;
    parts.push_back(second);
  }
  return parts;
}

void set(Lanes3& lanes, int lane, const Eigen::Vector3f& v) {
  set_lane(lanes, lane, v.x(), v.y(), v.z());
}

TriangleBlock block_of(const TriangleMesh& mesh, const std::vector<Eigen::Vector3f>& normals, Range range) {
  TriangleBlock block{};
  for (size_t k = 0; k < kLanes; ++k) {
    const int lane = static_cast<int>(k);
    block.triangle[k] = -1;
    set(block.a, lane, Eigen::Vector3f::Constant(SurfaceTree::kFarOutside_mm));
    if (k >= range.size()) continue;
    const auto t = static_cast<size_t>(range[k].triangle);
    const Eigen::Vector3i& corners = mesh.triangles[t];
    const Eigen::Vector3f& a = mesh.vertices[static_cast<size_t>(corners[0])];
    const Eigen::Vector3f ab = mesh.vertices[static_cast<size_t>(corners[1])] - a,
                          ac = mesh.vertices[static_cast<size_t>(corners[2])] - a;
    block.triangle[k] = range[k].triangle;
    set(block.a, lane, a);
    set(block.ab, lane, ab);
    set(block.ac, lane, ac);
    set(block.n, lane, normals[t]);
    // A side that is too short to be inverted is as good as a point.
    const auto inverse = [](float squared) { return squared > 1e-30f ? 1 / squared : 0; };
    block.inverse_ab[lane] = inverse(ab.squaredNorm());
    block.inverse_ac[lane] = inverse(ac.squaredNorm());
    block.inverse_bc[lane] = inverse((ac - ab).squaredNorm());
  }
  return block;
}

struct Subtree {
  LargeVector<TreeNode> nodes;
  std::vector<Range> leaves;  ///< The blocks to be.
};

void append(const Part& whole, int level, Subtree& to);

void append_child(const Part& part, int level, Subtree& to) {
  if (part.range.size() > kLanes) {
    append(part, level, to);
  } else {
    to.leaves.push_back(part.range);
  }
}

/// Appends a node over the part, and all that is below it.
void append(const Part& whole, int level, Subtree& to) {
  const size_t here = to.nodes.size();
  to.nodes.emplace_back();
  TreeNode node{};
  const std::vector<Part> parts = split_in_eight(whole, level);
  for (int k = 0; k < kLanes; ++k) {
    const bool used = static_cast<size_t>(k) < parts.size();
    const Eigen::Vector3f outside = Eigen::Vector3f::Constant(SurfaceTree::kFarOutside_mm);
    set(node.low, k, used ? parts[static_cast<size_t>(k)].bounds.low.head<3>() : outside);
    set(node.high, k, used ? parts[static_cast<size_t>(k)].bounds.high.head<3>() : outside);
    node.child[k] = ~0;
  }
  std::vector<Subtree> tasks(whole.range.size() > kTask ? parts.size() : 0);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t k) { append_child(parts[k], level + 1, tasks[k]); });
  for (size_t k = 0; k < parts.size(); ++k) {
    const int first_node = static_cast<int>(to.nodes.size()), first_leaf = static_cast<int>(to.leaves.size());
    node.child[k] = parts[k].range.size() > kLanes ? first_node : ~first_leaf;
    if (tasks.empty()) {
      append_child(parts[k], level + 1, to);
      continue;
    }
    for (TreeNode& n : tasks[k].nodes)
      for (int& child : n.child) child += child >= 0 ? first_node : -first_leaf;
    to.nodes.insert(to.nodes.end(), tasks[k].nodes.begin(), tasks[k].nodes.end());
    to.leaves.insert(to.leaves.end(), tasks[k].leaves.begin(), tasks[k].leaves.end());
    tasks[k] = {};
  }
  to.nodes[here] = node;
}

}  // namespace

SurfaceTree::SurfaceTree(const TriangleMesh& mesh, const std::vector<Eigen::Vector3f>& normals) {
  LargeVector<Primitive> primitives(mesh.triangles.size());
  longest_side = tbb::parallel_reduce(
      tbb::blocked_range(size_t{0}, primitives.size()), 0.0f,
      [&](const auto& range, float longest) {
        for (size_t t = range.begin(); t < range.end(); ++t) {
          Primitive& p = primitives[t] = {};
          if (normals[t].isZero()) continue;
          p.triangle = static_cast<int>(t);
          for (const int corner : mesh.triangles[t])
            p.box.extend(mesh.vertices[static_cast<size_t>(corner)].homogeneous().array());
          longest = std::max(longest, (p.box.high - p.box.low).head<3>().matrix().norm());
        }
        return longest;
      },
      [](float a, float b) { return std::max(a, b); });
  std::erase_if(primitives, [](const Primitive& p) { return p.triangle < 0; });
  triangles = primitives.size();
  if (primitives.empty()) return;
  Subtree all;
  append(Part::of(primitives), 0, all);
  nodes = std::move(all.nodes);
  blocks.resize(all.leaves.size());
  block_of_triangle.assign(mesh.triangles.size(), -1);
  tbb::parallel_for(size_t{0}, all.leaves.size(), [&](size_t k) {
    blocks[k] = block_of(mesh, normals, all.leaves[k]);
    for (const Primitive& p : all.leaves[k])
      block_of_triangle[static_cast<size_t>(p.triangle)] = static_cast<int>(k);
  });
}

}  // namespace gantry::internal
