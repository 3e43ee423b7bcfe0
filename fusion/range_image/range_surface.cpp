#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gantry/foundation/error.h"
#include "gantry/fusion/preprocess.h"
#include "range_image/grid_normals.h"
#include "range_image/ray_model.h"
#include "range_image/regrid.h"
#include "range_image/simd.h"
#include "range_image/surface_edges.h"

namespace gantry {
namespace {

/// Neighbours further apart in depth than this many pixel pitches belong to different surfaces. A
/// continuous surface reaches it only beyond 80 degrees of incidence, where there is little to measure.
constexpr float kStepInPitches = 6;
/// ... or this many standard deviations of the noise, where that is more.
constexpr float kStepInSigmas = 7;
/// A point further than this from the plane of its window is an outlier. Creases reach more than a pitch,
/// and must pass: they are what keeps faces from sliding.
constexpr float kOutlierInSigmas = 5;
constexpr float kOutlierInPitches = 3;
/// Closer to edge-on than 75 degrees neither side nor position of a surface is certain.
constexpr float kGrazingCosine = 0.25f;
/// Windows grow until noise tilts the normals by less than this (rad).
constexpr double kNormalSigma = 0.03;
constexpr int kLargestWindow = 9;
constexpr size_t kMinPoints = 100;

float median_of(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Noise of w (one sigma) from second differences along rows, which surfaces hardly have.
float noise_of_w(const RangeSurface& s) {
  std::vector<float> differences;
  const int row_step = std::max(1, s.height / 200);
  for (int row = 0; row < s.height; row += row_step) {
    const float* w = s.w.data() + s.index(0, row);
    for (int c = 1; c + 1 < s.width; ++c)
      if (w[c - 1] != 0 && w[c] != 0 && w[c + 1] != 0)
        differences.push_back(std::abs(w[c - 1] - 2 * w[c] + w[c + 1]));
  }
  return 1.4826f / std::sqrt(6.0f) * median_of(differences);
}

/// RangeSurface::noise_scale, from second differences along rows, each seen along its own normal: on faces at
/// a slant the depth scatters by more than the surface does.
double noise_along_normals(const RangeSurface& s) {
  std::vector<float> differences;
  const int row_step = std::max(1, s.height / 200);
  for (int row = 0; row < s.height; row += row_step)
    for (int c = 1; c + 1 < s.width; ++c) {
      const size_t i = s.index(c, row);
      if (s.w[i - 1] == 0 || s.w[i] == 0 || s.w[i + 1] == 0) continue;
      const Eigen::Vector3f normal = unpack_normal(s.normals[i]);
      const Eigen::Vector2f ray = s.rays.ray(c, row).cast<float>();
      // Of the depth 1 / w the share along the normal, over the squared distance: both with x^2 + y^2 + 1.
      const float along =
          s.rays.central
              ? std::abs(normal.x() * ray.x() + normal.y() * ray.y() + normal.z()) / (ray.squaredNorm() + 1)
              : std::abs(normal.z());
      differences.push_back(along * std::abs(s.w[i - 1] - 2 * s.w[i] + s.w[i + 1]));
    }
  return 1.4826 / std::sqrt(6.0) * median_of(differences);
}

/// Width of a pixel at depth coordinate w, in units of w: how much w changes over a depth of one pitch.
struct Pitch {
  bool central;
  float per_ray;  // pitch in (u, v)
  float in_w(float w) const { return central ? per_ray * w : per_ray; }
};

Pitch pitch_of(const RangeSurface& s) {
  const double c = 0.5 * s.width, r = 0.5 * s.height;
  const double along_row = (s.rays.ray(c + 1, r) - s.rays.ray(c, r)).norm();
  const double along_column = (s.rays.ray(c, r + 1) - s.rays.ray(c, r)).norm();
  return {s.rays.central, static_cast<float>(std::max(along_row, along_column))};
}

/// Least and greatest of each value and its two neighbours along the row, nothing (0) left aside.
GANTRY_MULTIVERSION void extremes_along_row(const float* __restrict w, int width, float* __restrict least,
                                            float* __restrict greatest) {
  constexpr float kNone = 3e38f;
  for (int c = 0; c < width; ++c) {
    const float a = w[c > 0 ? c - 1 : 0], b = w[c], d = w[c + 1 < width ? c + 1 : c];
    const float a1 = a == 0 ? kNone : a, b1 = b == 0 ? kNone : b, d1 = d == 0 ? kNone : d;
    const float ab = a1 < b1 ? a1 : b1, most = a > b ? a : b;
    least[c] = ab < d1 ? ab : d1;
    greatest[c] = most > d ? most : d;
  }
}

/// Marks what differs by more than a step from the extremes of its surroundings.
GANTRY_MULTIVERSION void mark_steps(const float* __restrict w, const float* __restrict least,
                                    const float* __restrict greatest, int width, float per_w, float fixed,
                                    unsigned char* __restrict out) {
  for (int c = 0; c < width; ++c) {
    const float by_depth = per_w * w[c];
    const float limit = by_depth > fixed ? by_depth : fixed;
    out[c] = (w[c] != 0) & ((greatest[c] - w[c] > limit) | (w[c] - least[c] > limit));
  }
}

/// Drops (w = 0) pixels within `margin` of a depth step.
size_t drop_steps(RangeSurface& s, const Pitch& pitch, float sigma_w, int margin) {
  const auto width = static_cast<size_t>(s.width);
  std::vector<float> least(s.w.size()), greatest(s.w.size());
  std::vector<unsigned char> at_step(s.w.size());
  tbb::parallel_for(0, s.height, [&](int row) {
    const size_t i = s.index(0, row);
    extremes_along_row(&s.w[i], s.width, &least[i], &greatest[i]);
  });
  const float fixed =
      std::max(kStepInSigmas * sigma_w, pitch.central ? 0.0f : kStepInPitches * pitch.per_ray);
  const float per_w = pitch.central ? kStepInPitches * pitch.per_ray : 0.0f;
  tbb::parallel_for(0, s.height, [&](int row) {
    const size_t i = s.index(0, row);
    std::vector<float> low(least.begin() + static_cast<std::ptrdiff_t>(i),
                           least.begin() + static_cast<std::ptrdiff_t>(i + width)),
        high(greatest.begin() + static_cast<std::ptrdiff_t>(i),
             greatest.begin() + static_cast<std::ptrdiff_t>(i + width));
    for (const int r : {row - 1, row + 1}) {
      if (r < 0 || r >= s.height) continue;
      const size_t k = s.index(0, r);
      for (size_t c = 0; c < width; ++c) {
        low[c] = std::min(low[c], least[k + c]);
        high[c] = std::max(high[c], greatest[k + c]);
      }
    }
    mark_steps(&s.w[i], low.data(), high.data(), s.width, per_w, fixed, &at_step[i]);
  });
  size_t dropped = 0;
  for (size_t i = 0; i < at_step.size(); ++i) {
    if (!at_step[i]) continue;
    const int row = static_cast<int>(i / width), column = static_cast<int>(i % width);
    for (int r = std::max(0, row - margin); r <= std::min(s.height - 1, row + margin); ++r)
      for (int c = std::max(0, column - margin); c <= std::min(s.width - 1, column + margin); ++c) {
        float& w = s.w[s.index(c, r)];
        dropped += w != 0;
        w = 0;
      }
  }
  return dropped;
}

int window_for(double noise_mm, double pitch_mm) {
  for (int half = 3; half < kLargestWindow; ++half) {
    const double n = 2 * half + 1;
    if (noise_mm / (pitch_mm * std::sqrt(n * n * (n * n - 1) / 12)) < kNormalSigma) return half;
  }
  return kLargestWindow;
}

/// Normal of the plane w = value + slopes . (pixel - here), towards the sensor, in the grid frame.
Eigen::Vector3f normal_of_plane(const RayModel& rays, const Eigen::Vector2f& ray, float w,
                                const Eigen::Vector2f& slope_per_ray) {
  if (!rays.central) return Eigen::Vector3f(slope_per_ray.x(), slope_per_ray.y(), -1).normalized();
  // 1 = (w - slope . ray) z + slope . (x, y)
  return -Eigen::Vector3f(slope_per_ray.x(), slope_per_ray.y(), w - slope_per_ray.dot(ray)).normalized();
}

/// Fits a normal to every pixel; drops outliers and grazing points, marks the rim.
size_t fit_normals(RangeSurface& s, const Pitch& pitch, float sigma_w, int half, double min_fill) {
  const float full = static_cast<float>((2 * half + 1) * (2 * half + 1) - 9);
  const std::vector<float> w = s.w;
  const Eigen::Matrix<float, 2, 3> to_ray = s.rays.ray_of_pixel.leftCols<3>().cast<float>();
  s.normals.assign(w.size(), {});
  // Slopes per pixel become slopes per ray; the map between the two is all but constant over the image.
  const RayModel::Polynomial& to_pixel = s.rays.pixel_of_ray;
  const Eigen::Matrix2f linear = to_pixel.block<2, 2>(0, 1).transpose().cast<float>();
  internal::fit_windows(w, s.width, s.height, half, [&](int row, const internal::WindowFit& fit) {
    for (int column = 0; column < s.width; ++column) {
      const size_t i = s.index(column, row);
      if (w[i] == 0) continue;
      s.w[i] = 0;
      if (fit.count[column] < 6) continue;
      const float limit = std::max(kOutlierInSigmas * sigma_w, kOutlierInPitches * pitch.in_w(w[i]));
      if (!(std::abs(w[i] - fit.value[column]) <= limit)) continue;
      Eigen::Vector2f ray = to_ray * Eigen::Vector3f(1, static_cast<float>(column), static_cast<float>(row));
      Eigen::Matrix2f jacobian = linear;
      if (s.rays.distorted) {
        const Eigen::Vector2d exact = s.rays.ray(column, row);
        ray = exact.cast<float>();
        const Eigen::Vector2d h(1e-4, 0), v(0, 1e-4);
        jacobian.row(0) = ((s.rays.pixel(exact + h) - s.rays.pixel(exact - h)) / 2e-4).cast<float>();
        jacobian.row(1) = ((s.rays.pixel(exact + v) - s.rays.pixel(exact - v)) / 2e-4).cast<float>();
      }
      const Eigen::Vector2f slope =
          jacobian * Eigen::Vector2f(fit.column_slope[column], fit.row_slope[column]);
      const Eigen::Vector3f n = normal_of_plane(s.rays, ray, fit.value[column], slope);
      const Eigen::Vector3f along =
          s.rays.central ? ray.homogeneous().normalized().eval() : Eigen::Vector3f(0, 0, 1);
      if (!(-n.dot(along) >= kGrazingCosine)) continue;
      s.w[i] = w[i];
      s.normals[i] = pack_normal(n);
      s.flags[i] |= RangeSurface::kUsable;
      if (fit.count[column] < min_fill * full) s.flags[i] |= RangeSurface::kRim;
    }
  });
  size_t dropped = 0;
  for (size_t i = 0; i < w.size(); ++i) dropped += w[i] != 0 && s.w[i] == 0;
  return dropped;
}

}  // namespace

PackedNormal pack_normal(const Eigen::Vector3f& n) {
  const float sum = n.cwiseAbs().sum();
  float a = n.x() / sum, b = n.y() / sum;
  if (n.z() < 0) {
    const float folded_a = (1 - std::abs(b)) * (a >= 0 ? 1.0f : -1.0f);
    b = (1 - std::abs(a)) * (b >= 0 ? 1.0f : -1.0f);
    a = folded_a;
  }
  return {static_cast<int16_t>(std::lrint(32767 * a)), static_cast<int16_t>(std::lrint(32767 * b))};
}

RangeSurface make_range_surface(const TaggedScan& tagged, const PreprocessOptions& options) {
  validate(options);
  const Scan& scan = tagged.scan;
  RangeSurface s;
  s.name = tagged.name;
  s.part_from_sensor = tagged.part_from_sensor;
  // Rows are worked on in parallel; a scan without grid is cut into pieces.
  const Pose& pose = tagged.part_from_sensor.mean;
  std::vector<unsigned char> keep(scan.points.size());
  constexpr size_t kPiece = 4096;
  const size_t pieces = (keep.size() + kPiece - 1) / kPiece;
  std::vector<size_t> measured(pieces, 0), cropped(pieces, 0);
  tbb::parallel_for(size_t{0}, pieces, [&](size_t piece) {
    for (size_t i = piece * kPiece; i < std::min(keep.size(), (piece + 1) * kPiece); ++i) {
      // The origin itself is what many sensors write where they measured nothing.
      keep[i] = scan.valid(i) && !scan.points[i].isZero(0);
      if (!keep[i]) continue;
      ++measured[piece];
      if (options.crop_part_mm)
        keep[i] = options.crop_part_mm->contains(pose * scan.points[i].cast<double>());
      cropped[piece] += !keep[i];
    }
  });
  s.measured = std::accumulate(measured.begin(), measured.end(), size_t{0});
  s.dropped_crop = std::accumulate(cropped.begin(), cropped.end(), size_t{0});
  const auto too_few = [&](size_t left) {
    return InputError(
        "scan " + tagged.name + ": only " + std::to_string(left) + " of " + std::to_string(s.measured) +
        " measured points are left after cropping (" + std::to_string(s.dropped_crop) +
        " outside the part's volume) and filtering; at least " + std::to_string(kMinPoints) + " are needed");
  };
  if (s.measured - s.dropped_crop < kMinPoints) throw too_few(s.measured - s.dropped_crop);
  const bool own_grid = internal::lay_out(scan, keep, s);

  const Pitch pitch = pitch_of(s);
  const float sigma_w = noise_of_w(s);
  const std::vector<float> before = s.w;
  s.dropped_edges = drop_steps(s, pitch, sigma_w, options.edge_margin_px);
  std::vector<float> depths;
  for (size_t i = 0; i < s.w.size(); i += 7)
    if (s.w[i] != 0) depths.push_back(s.w[i]);
  const double w_middle = median_of(depths);
  if (!(w_middle > 0)) throw too_few(0);
  const double depth = s.rays.central ? 1 / w_middle : 1;
  const double pitch_mm = pitch.per_ray * depth;
  const double noise_mm = s.rays.central ? sigma_w * depth * depth : sigma_w;
  s.spacing_mm = pitch_mm;
  s.normal_window_px =
      options.normal_window_px > 0 ? options.normal_window_px : window_for(noise_mm, pitch_mm);
  s.dropped_edges += fit_normals(s, pitch, sigma_w, s.normal_window_px, options.min_window_fill);
  s.noise_mm = std::max(noise_mm, 1e-6);
  s.noise_scale = noise_along_normals(s);
  for (const unsigned char flag : s.flags) s.usable += (flag & RangeSurface::kUsable) != 0;
  if (s.usable < kMinPoints) throw too_few(s.usable);
  // In a grid of our own nothing is left of cropped points, and where they begin is no edge.
  if (own_grid || s.dropped_crop == 0) s.edges = internal::find_edges(s, before, sigma_w, pitch.per_ray);
  return s;
}

void turn_over(RangeSurface& s) {
  const Eigen::Vector3d half_turn(1, -1, -1);  // about x
  s.sensor_from_grid.linear() = s.sensor_from_grid.linear() * half_turn.asDiagonal();
  // v changes sign: as the value of one map, as the argument of the other.
  s.rays.ray_of_pixel.row(1) *= -1;
  for (const int odd : {2, 4, 7, 9}) s.rays.pixel_of_ray.col(odd) *= -1;  // b, ab, aab, bbb
  float most = 0;
  for (const float w : s.w) most = std::max(most, w);
  s.sensor_from_grid = s.sensor_from_grid * Eigen::Translation3d(0, 0, -most - 1);
  for (size_t i = 0; i < s.w.size(); ++i) {
    if (s.w[i] == 0) continue;
    s.w[i] = most + 1 - s.w[i];
    const Eigen::Vector3f n = unpack_normal(s.normals[i]);
    s.normals[i] = pack_normal(-Eigen::Vector3f(n.x(), -n.y(), -n.z()));
  }
  for (SurfaceEdge& edge : s.edges) {
    edge.point = Eigen::Vector3f(edge.point.x(), -edge.point.y(), most + 1 - edge.point.z());
    edge.normal = -Eigen::Vector3f(edge.normal.x(), -edge.normal.y(), -edge.normal.z());
    edge.outwards = Eigen::Vector3f(edge.outwards.x(), -edge.outwards.y(), -edge.outwards.z());
  }
}

size_t settle_unknown_sides(std::span<RangeSurface> surfaces) {
  const auto each_point = [](const RangeSurface& s, auto&& visit) {
    const Pose pose = s.part_from_grid();
    for (int row = 0; row < s.height; row += 4)
      for (int column = 0; column < s.width; column += 4)
        if (const size_t i = s.index(column, row); s.w[i] != 0)
          visit(pose * s.point(column, row), pose.linear() * unpack_normal(s.normals[i]).cast<double>());
  };
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const RangeSurface& s : surfaces)
    each_point(s, [&](const Eigen::Vector3d& p, const Eigen::Vector3d&) {
      sum += p;
      ++count;
    });
  size_t turned = 0;
  for (RangeSurface& s : surfaces) {
    if (s.sensor_known) continue;
    double outwards = 0;
    each_point(
        s, [&](const Eigen::Vector3d& p, const Eigen::Vector3d& n) { outwards += n.dot(p - sum / count); });
    if (outwards >= 0) continue;
    turn_over(s);
    ++turned;
  }
  return turned;
}

PointCloud surface_cloud(const RangeSurface& s, std::vector<unsigned char>* rim) {
  PointCloud cloud;
  if (rim) rim->clear();
  for (int row = 0; row < s.height; ++row) {
    for (int column = 0; column < s.width; ++column) {
      const size_t i = s.index(column, row);
      if (s.w[i] == 0) continue;
      const Eigen::Vector3d p = s.point(column, row);
      cloud.points.push_back((s.sensor_from_grid * p).cast<float>());
      cloud.normals.push_back(s.sensor_from_grid.linear().cast<float>() * unpack_normal(s.normals[i]));
      cloud.sigma_mm.push_back(static_cast<float>(std::max(s.sigma_mm(p), 1e-6)));
      if (rim) rim->push_back((s.flags[i] & RangeSurface::kRim) != 0);
    }
  }
  return cloud;
}

}  // namespace gantry
