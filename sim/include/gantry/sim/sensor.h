#pragma once

#include <cstdint>

#include "gantry/geometry/ray_scene.h"
#include "gantry/geometry/scan.h"

namespace gantry {

/// A structured-light sensor: geometry after the paper (section "Synthetic Data Generation": 1920 x
/// 1200 px, 38.70 x 24.75 degrees, 350 to 700 mm) and an error model.
struct SensorModel {
  int width = 1920;
  int height = 1200;
  double horizontal_fov_rad = 0.675442;  ///< 38.70 degrees.
  double vertical_fov_rad = 0.431969;    ///< 24.75 degrees.
  double near_mm = 350;                  ///< Depth of field: nothing is measured outside.
  double far_mm = 700;
  /// Projector to the right of the camera; what it cannot light is not measured. 0: no shadows.
  double projector_offset_mm = 100;

  /// Range noise (one sigma) along the ray at 500 mm, frontal. It grows with the square of the distance
  /// (triangulation) and with 1 / cos(incidence) (the fringe is stretched).
  double noise_mm = 0.05;
  double max_incidence_rad = 1.3963;  ///< 80 degrees: beyond it nothing is measured.
  /// Pixels next to a depth step see both surfaces; with this probability they report a range in between.
  double mixed_pixel_probability = 0.3;
  /// A depth step: what neighbours hit lies further than this, along the ray, off each other's tangent plane.
  double mixed_pixel_step_mm = 1.0;
  /// What calibration leaves over: a range error that is the same in every scan, smooth over the measuring
  /// volume (waves of half its width and more), with this root mean square. Which, says the seed.
  double distortion_mm = 0;
  uint64_t distortion_seed = 1;
  double dropout_probability = 0.002;  ///< Of any pixel; rises to 1 between 60 degrees and max_incidence.

  double focal_x_px() const;
  double focal_y_px() const;
};

/// Ray-traces one scan of the scene. The sensor moves relative to the scene from `begin` to `end` while
/// it exposes (row by row), as it does when a stage has not settled. Every random number is a function
/// of (seed, scan number, pixel): the same arguments give the same scan on any number of threads.
Scan trace_scan(const SensorModel& model, const RayScene& scene, const Pose& begin_scene_from_sensor,
                const Pose& end_scene_from_sensor, uint64_t seed, uint64_t scan_number);

}  // namespace gantry
