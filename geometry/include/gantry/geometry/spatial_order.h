#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace gantry {

/// The order of points along a Morton curve of 1024 cells a side: neighbours in it are neighbours in space.
/// Searching for points in this order is several times as fast as in any order, for the cache's sake, and
/// each answer is a good guess for the next. Points of one cell keep their order. Points that are not finite
/// lie anywhere in it.
std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points);

/// Calls `visit` with runs of indices of points that lie together in space, all points once, on all threads.
/// How they are cut into runs does not depend on the number of threads.
void for_each_run(std::span<const Eigen::Vector3f> points,
                  const std::function<void(std::span<const uint32_t>)>& visit);

}  // namespace gantry
