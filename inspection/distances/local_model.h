#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

namespace gantry::internal {

/// Distances (mm, 0 or more) from a point to a surface through some points, its `neighbours`. Nothing where
/// the neighbours do not make a surface: too few, or in a line. See Metric::kPlane and those after it.
using LocalModel = std::optional<double> (*)(std::span<const Eigen::Vector3d> neighbours,
                                             const Eigen::Vector3d& point);

constexpr size_t kMostNeighbours = 64;

/// To the plane with the least sum of squared distances (Pearson, 1901).
std::optional<double> distance_to_plane(std::span<const Eigen::Vector3d> neighbours,
                                        const Eigen::Vector3d& point);

/// Along the normal of that plane, to the quadratic height field fitted over it.
std::optional<double> distance_to_quadric(std::span<const Eigen::Vector3d> neighbours,
                                          const Eigen::Vector3d& point);

/// To the nearest triangle of the Delaunay triangulation of the neighbours projected into that plane.
std::optional<double> distance_to_triangulation(std::span<const Eigen::Vector3d> neighbours,
                                                const Eigen::Vector3d& point);

}  // namespace gantry::internal
