#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "camera_features.h"
#include "gantry/geometry/scan.h"

namespace gantry {

/// What the numbers in a Coord3D_ABC32f image mean (SFNC, 3D Scan Control):
/// coordinate in mm = raw * scale + offset, for each of A, B, C = x, y, z.
struct RangeFormat {
  int width = 0;
  int height = 0;
  std::array<float, 3> scale_mm{1, 1, 1};
  std::array<float, 3> offset_mm{0, 0, 0};
  float invalid_depth = 0;  ///< Raw C of a pixel without a measurement.

  size_t image_bytes() const { return static_cast<size_t>(width) * height * 3 * sizeof(float); }
};

/// Selects Coord3D_ABC32f, Cartesian, on the full sensor, and reads its meaning. Throws FaultException
/// naming the feature that is missing or that makes the data unusable.
RangeFormat configure_range_format(const Features& features);

/// Decodes one image of `format.image_bytes()` bytes, little-endian. A pixel is without measurement
/// when its raw C is the invalid value, or when any coordinate is not finite.
Scan decode_range_image(const RangeFormat& format, std::span<const std::byte> image);

}  // namespace gantry
