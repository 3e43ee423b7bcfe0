#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "gantry/geometry/pose.h"
#include "gantry/geometry/ray_scene.h"
#include "gantry/geometry/scan.h"
#include "gantry/geometry/triangle_mesh.h"
#include "gantry/sim/sensor.h"

/// What trials of registration are made of: a part, scans of it from poisson_disc_views(), and initial poses
/// that are wrong by perturbation() (views.h). gantry-parts writes them to files, the benchmarks keep them.

namespace gantry {

/// Scaled to the height (extent along y) and moved so that the middle of its bounding box is the origin: how
/// the paper takes the Stanford bunny. Throws InputError unless the height is positive and the mesh has one.
TriangleMesh scaled_to_height(TriangleMesh mesh, double height_mm);

/// Scan number `view` of a part at rest. Deterministic in (noise_seed, view).
Scan scan_of_view(const SensorModel& sensor, const RayScene& scene, const std::vector<Pose>& part_from_sensor,
                  size_t view, uint64_t noise_seed);

/// The measured points alone, in their order, without the grid: as files of merged or exported points are.
Scan without_grid(const Scan& scan);

/// Every true pose perturbed about the part's centre, by a band in degrees and mm as perturbation() has it.
std::vector<Pose> perturbed_poses(std::span<const Pose> truth, const Eigen::Vector3d& centre, double from,
                                  double to, uint64_t seed);

}  // namespace gantry
