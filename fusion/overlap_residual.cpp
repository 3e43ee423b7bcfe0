#include "gantry/fusion/overlap_residual.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "joint/projection.h"

namespace gantry {
namespace {

constexpr float kReach_mm = 2;
constexpr float kLeastCosine = 0.7071f;
/// Points of a scan that are looked at for each other scan: all in all about this many, within limits.
constexpr double kAllSamples = 120000, kMostSamples = 5000, kLeastSamples = 200;
/// The window that the nearest point is sought in reaches at most so far (pixels).
constexpr int kWidestWindow = 32;

/// The usable pixel of `target` whose point lies nearest to `p` (grid frame), near a given pixel: first on a
/// sparse raster over the window that a sphere of kReach_mm can fill, then downhill with ever smaller steps.
class NearestPixel {
 public:
  explicit NearestPixel(const RangeSurface& target)
      : target_(target),
        to_ray_(target.rays.ray_of_pixel.leftCols<3>()),
        first_step_(std::clamp(static_cast<int>(std::ceil(kReach_mm / (3 * target.spacing_mm))), 1,
                               kWidestWindow / 3)) {}

  std::optional<size_t> find(const Eigen::Vector3f& p, int column, int row) {
    p_ = p.cast<double>();
    nearest_ = kReach_mm * kReach_mm;
    found_ = false;
    search(column, row, 3, first_step_);
    for (int step = first_step_; found_ && step > 1;) {
      step = (step + 1) / 2;
      search(column_, row_, 1, step);
    }
    for (double before = 2 * nearest_; found_ && nearest_ < before;) {
      before = nearest_;
      search(column_, row_, 1, 1);
    }
    return found_ ? std::optional(target_.index(column_, row_)) : std::nullopt;
  }
  /// Of the last pixel found.
  Eigen::Vector3d point() const { return point(column_, row_); }

 private:
  Eigen::Vector3d point(int column, int row) const {
    const Eigen::Vector2d ray = target_.rays.distorted
                                    ? target_.rays.ray(column, row)
                                    : Eigen::Vector2d(to_ray_ * Eigen::Vector3d(1, column, row));
    return target_.rays.point(ray, target_.w[target_.index(column, row)]);
  }

  void search(int column, int row, int count, int step) {
    for (int r = row - count * step; r <= row + count * step; r += step)
      for (int c = column - count * step; c <= column + count * step; c += step) {
        if (c < 0 || r < 0 || c >= target_.width || r >= target_.height) continue;
        if (target_.w[target_.index(c, r)] == 0) continue;
        const double squared = (point(c, r) - p_).squaredNorm();
        if (squared >= nearest_) continue;
        nearest_ = squared;
        column_ = c;
        row_ = r;
        found_ = true;
      }
  }

  const RangeSurface& target_;
  const Eigen::Matrix<double, 2, 3> to_ray_;
  const int first_step_;
  Eigen::Vector3d p_ = Eigen::Vector3d::Zero();
  double nearest_ = 0;
  int column_ = 0, row_ = 0;
  bool found_ = false;
};

std::vector<float> distances(const RangeSurface& target, const RangeSurface& source,
                             const Pose& target_from_source, double samples) {
  const int stride =
      std::max(1, static_cast<int>(std::lround(std::sqrt(static_cast<double>(source.usable) / samples))));
  const internal::Projector projector(target, source, target_from_source);
  NearestPixel nearest(target);
  std::vector<float> out;
  projector.block<true>(0, source.width, 0, source.height, stride, [&](const internal::Projected& at) {
    const std::optional<size_t> pixel = nearest.find(at.p, at.column, at.row);
    if (!pixel || (target.flags[*pixel] & RangeSurface::kRim)) return;
    const Eigen::Vector3f n = unpack_normal(target.normals[*pixel]);
    if (n.dot(at.n) < kLeastCosine) return;
    out.push_back(static_cast<float>(std::abs(n.cast<double>().dot(at.p.cast<double>() - nearest.point()))));
  });
  return out;
}

double trimmed_rms(std::vector<float> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  values.resize(std::max<size_t>(1, values.size() * 9 / 10));
  double squares = 0;
  for (const float v : values) squares += static_cast<double>(v) * v;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

}  // namespace

OverlapResidual overlap_residual(std::span<const RangeSurface> scans, std::span<const Pose> part_from_sensor,
                                 std::vector<double>* rms_of_scan_mm) {
  const size_t n = scans.size();
  const double samples = std::clamp(kAllSamples / static_cast<double>(std::max<size_t>(1, n * n - n)),
                                    kLeastSamples, kMostSamples);
  std::vector<std::vector<float>> of_pair(n * n);
  tbb::parallel_for(size_t{0}, n * n, [&](size_t k) {
    const size_t target = k / n, source = k % n;
    if (target == source) return;
    const Pose part_from_target = part_from_sensor[target] * scans[target].sensor_from_grid;
    const Pose part_from_source = part_from_sensor[source] * scans[source].sensor_from_grid;
    of_pair[k] =
        distances(scans[target], scans[source], part_from_target.inverse() * part_from_source, samples);
  });
  std::vector<float> all;
  for (const auto& values : of_pair) all.insert(all.end(), values.begin(), values.end());
  if (rms_of_scan_mm) {
    rms_of_scan_mm->assign(n, 0);
    tbb::parallel_for(size_t{0}, n, [&](size_t i) {
      std::vector<float> values;
      for (size_t k = 0; k < of_pair.size(); ++k)
        if (k / n == i || k % n == i) values.insert(values.end(), of_pair[k].begin(), of_pair[k].end());
      (*rms_of_scan_mm)[i] = trimmed_rms(std::move(values));
    });
  }
  const size_t matches = all.size();
  return {trimmed_rms(std::move(all)), matches};
}

}  // namespace gantry
