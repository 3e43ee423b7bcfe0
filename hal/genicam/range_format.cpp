#include "range_format.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <sys/mman.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>

namespace gantry {

namespace {

constexpr const char* kPixelFormat = "Coord3D_ABC32f";
constexpr const char* kPurpose = "range data in mm";
constexpr int64_t kMaxSide = 16384;
constexpr std::array<const char*, 3> kCoordinates = {"CoordinateA", "CoordinateB", "CoordinateC"};

int image_side(const Features& features, const char* feature) {
  const int64_t side = features.integer(feature);
  if (side < 1 || side > kMaxSide) {
    throw_fault(
        FaultKind::kProtocol, features.device(),
        std::string(feature) + " is " + std::to_string(side) + ", expected 1 to " + std::to_string(kMaxSide));
  }
  return static_cast<int>(side);
}

/// A region of interest that an earlier client left behind would silently cut the scan.
void select_full_sensor(const Features& features) {
  for (const char* offset : {"OffsetX", "OffsetY"}) {
    if (features.offers(offset) && features.integer(offset) != 0) features.set_integer(offset, 0);
  }
  for (auto [side, max] : {std::pair("Width", "WidthMax"), std::pair("Height", "HeightMax")}) {
    if (!features.offers(max)) continue;
    const int64_t full = features.integer(max);
    if (features.integer(side) != full) features.set_integer(side, full);
  }
}

void require_choice(const Features& features, const char* feature, const char* choice) {
  if (features.text(feature) == choice) return;
  if (!features.offers(feature, choice)) {
    throw_fault(
        FaultKind::kRefused, features.device(),
        std::string(feature) + " is " + features.text(feature) + " and " + choice + " is not offered");
  }
  features.set_text(feature, choice);
}

double mm_per_unit(const Features& features) {
  static const std::map<std::string, double> kUnits = {
      {"Millimeter", 1.0}, {"Meter", 1000.0}, {"Micrometer", 1e-3}, {"Inch", 25.4}};
  features.require("Scan3dDistanceUnit", kPurpose);
  const std::string unit = features.text("Scan3dDistanceUnit");
  const auto found = kUnits.find(unit);
  if (found == kUnits.end()) {
    throw_fault(FaultKind::kRefused, features.device(),
                "Scan3dDistanceUnit is " + unit + ", expected Millimeter, Micrometer, Meter or Inch");
  }
  return found->second;
}

float finite_number(const Features& features, const char* feature, const char* coordinate, bool may_be_zero) {
  const double value = features.number(feature);
  if (!std::isfinite(value) || (value == 0 && !may_be_zero)) {
    throw_fault(FaultKind::kRefused, features.device(),
                std::string(feature) + " of " + coordinate + " is " + std::to_string(value) +
                    ", which gives the range data no meaning");
  }
  return static_cast<float>(value);
}

/// Asks for huge pages in memory that was not touched yet: a full scan then costs a dozen page faults
/// instead of thousands, which would take longer than the decoding. Only a hint.
void prefer_huge_pages(void* memory, size_t bytes) {
  constexpr uintptr_t kHugePage = 2 << 20;
  const auto begin = (reinterpret_cast<uintptr_t>(memory) + kHugePage - 1) & ~(kHugePage - 1);
  const auto end = (reinterpret_cast<uintptr_t>(memory) + bytes) & ~(kHugePage - 1);
  if (begin < end) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

}  // namespace

RangeFormat configure_range_format(const Features& features) {
  features.require("PixelFormat", kPurpose);
  if (!features.offers("PixelFormat", kPixelFormat)) {
    throw_fault(FaultKind::kRefused, features.device(),
                std::string("the camera does not offer PixelFormat ") + kPixelFormat + " (it is set to " +
                    features.text("PixelFormat") + ")");
  }
  features.set_text("PixelFormat", kPixelFormat);
  select_full_sensor(features);

  for (const char* feature : {"Scan3dCoordinateSelector", "Scan3dCoordinateScale", "Scan3dCoordinateOffset",
                              "Scan3dInvalidDataFlag", "Scan3dInvalidDataValue", "Scan3dCoordinateSystem"}) {
    features.require(feature, kPurpose);
  }
  require_choice(features, "Scan3dCoordinateSystem", "Cartesian");
  // The grid keeps neighbours together: a scan is organised.
  if (features.offers("Scan3dOutputMode")) require_choice(features, "Scan3dOutputMode", "CalibratedABC_Grid");
  if (!features.boolean("Scan3dInvalidDataFlag")) features.set_boolean("Scan3dInvalidDataFlag", true);

  RangeFormat format;
  format.width = image_side(features, "Width");
  format.height = image_side(features, "Height");
  const double mm = mm_per_unit(features);
  for (size_t i = 0; i < kCoordinates.size(); ++i) {
    features.set_text("Scan3dCoordinateSelector", kCoordinates[i]);
    const float scale = finite_number(features, "Scan3dCoordinateScale", kCoordinates[i], false);
    const float offset = finite_number(features, "Scan3dCoordinateOffset", kCoordinates[i], true);
    format.scale_mm[i] = static_cast<float>(scale * mm);
    format.offset_mm[i] = static_cast<float>(offset * mm);
  }
  // CoordinateC is selected still: depth decides whether a pixel was measured, since x = 0 or y = 0
  // are ordinary coordinates even where 0 stands for "none".
  format.invalid_depth = static_cast<float>(features.number("Scan3dInvalidDataValue"));
  return format;
}

Scan decode_range_image(const RangeFormat& format, std::span<const std::byte> image) {
  static_assert(std::endian::native == std::endian::little, "GigE Vision images are little-endian");
  static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float));
  Scan scan;
  scan.width = format.width;
  scan.height = format.height;
  scan.points.reserve(static_cast<size_t>(format.width) * format.height);
  prefer_huge_pages(scan.points.data(), format.image_bytes());
  scan.points.resize(static_cast<size_t>(format.width) * format.height);

  const auto decode_rows = [&](const tbb::blocked_range<int>& rows) {
    const auto [sx, sy, sz] = format.scale_mm;
    const auto [ox, oy, oz] = format.offset_mm;
    const float invalid = format.invalid_depth;
    const size_t first = scan.index(0, rows.begin());
    const size_t last = scan.index(0, rows.end());
    const std::byte* source = image.data() + first * 3 * sizeof(float);
    for (size_t i = first; i < last; ++i, source += 3 * sizeof(float)) {
      float raw[3];
      std::memcpy(raw, source, sizeof(raw));
      const Eigen::Vector3f point(raw[0] * sx + ox, raw[1] * sy + oy, raw[2] * sz + oz);
      // The sum is finite only when all three are (coordinates are far from the overflow of a float).
      const bool measured = raw[2] != invalid && std::isfinite(point.x() + point.y() + point.z());
      scan.points[i] = measured ? point : invalid_point();
    }
  };
  tbb::parallel_for(tbb::blocked_range<int>(0, format.height, 64), decode_rows);
  return scan;
}

}  // namespace gantry
