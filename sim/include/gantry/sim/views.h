#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gantry/geometry/pose.h"
#include "gantry/geometry/triangle_mesh.h"
#include "gantry/sim/sensor.h"

namespace gantry {

/// `count` unit directions spread over the whole sphere by Poisson-disc sampling (dart throwing, the least
/// angle relaxed only when no dart fits any more). For 8 directions each one's nearest neighbour comes out
/// 58 to 80 degrees away, as in the paper's trials. They are ordered as a short path, so that consecutive
/// views overlap. Deterministic in `seed`. Throws InputError when `count` is 0.
std::vector<Eigen::Vector3d> poisson_disc_directions(size_t count, uint64_t seed);

/// Sensor poses (scene_from_sensor, mm) around a part as in the paper (section "Synthetic Data Generation"):
/// in Poisson-disc directions from the middle of the part's bounding box, 450 to 550 mm away, looking at
/// the middle but for a small offset, rolled by up to 10 degrees (by more only where the part fits no
/// otherwise). The whole part lies inside the field of view and depth of field. Deterministic in `seed`.
/// Throws InputError when the part is empty or too large for the sensor.
std::vector<Pose> poisson_disc_views(const TriangleMesh& part, const SensorModel& sensor, size_t count,
                                     uint64_t seed);

/// How wrong a scan's initial pose is made: a rotation about `centre` followed by a shift. Axis and direction
/// are uniform on the sphere; angle and length are drawn apart, uniform in [from, to], in degrees and in mm
/// (the paper's bands [0,1], [1,3], [3,6], [6,10], [10,15]). initial = perturbation * truth. Deterministic in
/// (seed, scan); the band only scales the same draw. Throws InputError unless 0 <= from <= to.
Pose perturbation(uint64_t seed, size_t scan, const Eigen::Vector3d& centre, double from, double to);

}  // namespace gantry
