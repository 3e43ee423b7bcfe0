#include "gantry/fusion/preprocess.h"

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// Windows leave out their inner nine pixels, so the smallest that holds any is 5 x 5.
constexpr int kSmallestWindow = 2, kLargestWindow = 50, kLargestMargin = 50;

}  // namespace

void validate(const PreprocessOptions& options) {
  const auto refuse = [](const char* key, const std::string& expected, const std::string& found) {
    throw InputError(std::string(key) + ": must be " + expected + ", found " + found);
  };
  const int window = options.normal_window_px, margin = options.edge_margin_px;
  if (window != 0 && (window < kSmallestWindow || window > kLargestWindow))
    refuse("normal_window_px", "in [2, 50], or 0 to choose it from the noise", std::to_string(window));
  if (margin < 0 || margin > kLargestMargin) refuse("edge_margin_px", "in [0, 50]", std::to_string(margin));
  if (!(options.min_window_fill >= 0 && options.min_window_fill <= 1))
    refuse("min_window_fill", "in [0, 1]", std::to_string(options.min_window_fill));
  if (options.crop_part_mm) {
    const Eigen::Vector3d sizes = options.crop_part_mm->sizes();
    // NaN fails this too.
    if (!(sizes.minCoeff() > 0))
      refuse("crop_part_mm", "a box whose lower corner lies below its upper one along x, y and z",
             "extents of " + std::to_string(sizes.x()) + ", " + std::to_string(sizes.y()) + " and " +
                 std::to_string(sizes.z()) + " mm");
  }
}

ScanSurface scan_surface(const RangeSurface& surface) {
  ScanSurface out;
  out.name = surface.name;
  out.part_from_sensor = surface.part_from_sensor;
  out.cloud = surface_cloud(surface, &out.rim);
  out.spacing_mm = surface.spacing_mm;
  out.noise_mm = surface.noise_mm;
  out.measured = surface.measured;
  out.dropped_crop = surface.dropped_crop;
  out.dropped_edges = surface.dropped_edges;
  out.dropped_hidden = surface.dropped_hidden;
  return out;
}

ScanSurface preprocess(const TaggedScan& scan, const PreprocessOptions& options) {
  return scan_surface(make_range_surface(scan, options));
}

}  // namespace gantry
