#include "range_image/regrid.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "gantry/foundation/error.h"
#include "range_image/grid_normals.h"
#include "range_image/ray_model.h"

namespace gantry::internal {
namespace {

constexpr int kMaxSide = 20000;
/// Of the grid that points without one are given: more are a few strays far away from all others.
constexpr double kMostPixelsPerPoint = 100, kFewPixels = 1e6;

struct Rectangle {
  int left = std::numeric_limits<int>::max(), top = std::numeric_limits<int>::max(), right = -1, bottom = -1;
  size_t count = 0;
  void add(int column, int row) {
    left = std::min(left, column);
    right = std::max(right, column);
    top = std::min(top, row);
    bottom = std::max(bottom, row);
  }
  void add(const Rectangle& o) {
    left = std::min(left, o.left);
    right = std::max(right, o.right);
    top = std::min(top, o.top);
    bottom = std::max(bottom, o.bottom);
    count += o.count;
  }
};

/// So many pixels around the data are kept, where the image goes on: it matters that they are empty.
constexpr int kRing = 5;

bool lay_out_grid(const Scan& scan, const std::vector<unsigned char>& keep, RangeSurface& s) {
  std::vector<Rectangle> rows(static_cast<size_t>(scan.height));
  tbb::parallel_for(0, scan.height, [&](int row) {
    const auto first = keep.begin() + static_cast<std::ptrdiff_t>(scan.index(0, row)),
               last = first + scan.width;
    const auto kept = std::find(first, last, 1);
    if (kept == last) return;
    rows[row].add(static_cast<int>(kept - first), row);
    rows[row].add(
        static_cast<int>(std::find(std::reverse_iterator(last), std::reverse_iterator(first), 1).base() -
                         first) -
            1,
        row);
    rows[row].count = static_cast<size_t>(std::count(first, last, 1));
  });
  Rectangle box;
  for (const Rectangle& row : rows) box.add(row);
  const size_t kept = box.count;
  box.left = std::max(0, box.left - kRing);
  box.top = std::max(0, box.top - kRing);
  box.right = std::min(scan.width - 1, box.right + kRing);
  box.bottom = std::min(scan.height - 1, box.bottom + kRing);
  std::vector<PixelSample> samples;
  const size_t step = std::max<size_t>(1, kept / 1500);
  size_t seen = 0;
  for (int row = box.top; row <= box.bottom; ++row)
    for (int column = box.left; column <= box.right; ++column)
      if (const size_t i = scan.index(column, row); keep[i] && seen++ % step == 0)
        samples.push_back({Eigen::Vector2d(column - box.left, row - box.top), scan.points[i].cast<double>()});
  const std::optional<FittedRays> fitted = fit_rays(samples);
  if (!fitted) return false;
  s.rays = fitted->rays;
  s.sensor_from_grid = fitted->sensor_from_grid;
  s.sensor_known = fitted->sensor_known;
  s.width = box.right - box.left + 1;
  s.height = box.bottom - box.top + 1;
  s.w.assign(static_cast<size_t>(s.width) * s.height, 0.0f);
  s.flags.assign(s.w.size(), 0);
  if (!s.rays.central) {  // depth counts from a little in front, so that 0 can mean nothing
    const Eigen::Vector3d z = s.sensor_from_grid.linear().col(2);
    double nearest = std::numeric_limits<double>::max();
    for (size_t i = 0; i < keep.size(); ++i)
      if (keep[i]) nearest = std::min(nearest, z.dot(scan.points[i].cast<double>()));
    s.sensor_from_grid = s.sensor_from_grid * Eigen::Translation3d(0, 0, nearest - 1);
  }
  const Pose grid_from_sensor = s.sensor_from_grid.inverse();
  const bool same_frame = grid_from_sensor.isApprox(Pose::Identity(), 1e-12);
  tbb::parallel_for(0, s.height, [&](int row) {
    for (int column = 0; column < s.width; ++column) {
      const size_t from = scan.index(column + box.left, row + box.top), to = s.index(column, row);
      if (scan.valid(from) && !scan.points[from].isZero(0)) s.flags[to] = RangeSurface::kSeen;
      if (!keep[from]) continue;
      const Eigen::Vector3f& p = scan.points[from];
      if (same_frame && s.rays.central) {
        s.w[to] = 1 / p.z();
      } else {
        s.w[to] = static_cast<float>(s.rays.w_of(grid_from_sensor * p.cast<double>()));
      }
    }
  });
  return true;
}

/// A way to look at points: (u, v) and w of each.
struct View {
  bool central;
  Pose sensor_from_grid;
};

struct Ray {
  double u, v, w;
};

Ray ray_of(const View& view, const Pose& grid_from_sensor, const Eigen::Vector3f& point) {
  const Eigen::Vector3d p = grid_from_sensor * point.cast<double>();
  return view.central ? Ray{p.x() / p.z(), p.y() / p.z(), 1 / p.z()} : Ray{p.x(), p.y(), p.z()};
}

Pose looking_along(const Eigen::Vector3d& z) {
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), z).toRotationMatrix();
  return pose;
}

/// Width of a cell (in u, v) such that about one point falls into each: from how many cells of a finer and
/// finer grid are occupied, until they stop being full.
double cell_for(const std::vector<Ray>& rays) {
  double min_u = 1e300, max_u = -1e300, min_v = 1e300, max_v = -1e300;
  for (const Ray& r : rays) {
    min_u = std::min(min_u, r.u);
    max_u = std::max(max_u, r.u);
    min_v = std::min(min_v, r.v);
    max_v = std::max(max_v, r.v);
  }
  const double side = std::max({max_u - min_u, max_v - min_v, 1e-9});
  double cell = side / 32;
  for (int round = 0; round < 4; ++round) {
    std::unordered_set<uint64_t> occupied;
    for (const Ray& r : rays)
      occupied.insert(static_cast<uint64_t>((r.u - min_u) / cell) << 32 |
                      static_cast<uint64_t>((r.v - min_v) / cell));
    const double density = static_cast<double>(rays.size()) / static_cast<double>(occupied.size());
    if (round > 0 && density < 8) return cell / std::sqrt(std::max(1.0, density));
    // Fine enough that the outline no longer inflates the area, still several points to a cell.
    cell = std::max(cell / std::max(1.0, std::sqrt(density / 6)), side / kMaxSide);
  }
  return cell;
}

/// Fraction of sampled points that lie well behind another of the same cell.
double hidden_fraction(const std::vector<Ray>& rays, double cell, bool central, double step_mm) {
  std::unordered_map<uint64_t, double> nearest;
  const auto key = [&](const Ray& r) {
    return static_cast<uint64_t>(static_cast<int64_t>(std::floor(r.u / (4 * cell))) + (1 << 30)) << 32 |
           static_cast<uint64_t>(static_cast<int64_t>(std::floor(r.v / (4 * cell))) + (1 << 30));
  };
  const auto depth = [&](const Ray& r) { return central ? 1 / r.w : r.w; };
  for (const Ray& r : rays) {
    const auto [at, fresh] = nearest.try_emplace(key(r), depth(r));
    if (!fresh) at->second = std::min(at->second, depth(r));
  }
  size_t hidden = 0;
  for (const Ray& r : rays) hidden += depth(r) > nearest[key(r)] + step_mm;
  return static_cast<double>(hidden) / static_cast<double>(std::max<size_t>(1, rays.size()));
}

/// The direction along which a grid looks whose rays are only about parallel (a line scanner's fan on a
/// stage): positions across it are nearly linear in column and row, so what a linear fit leaves over lies
/// along it. Its sign is meaningless.
Eigen::Vector3d viewing_axis(const Scan& scan, const std::vector<unsigned char>& keep) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero(), right = Eigen::Matrix3d::Zero();
  const auto each = [&](auto&& visit) {
    for (int row = 0; row < scan.height; row += 2)
      for (int column = 0; column < scan.width; column += 2)
        if (const size_t i = scan.index(column, row); keep[i])
          visit(Eigen::Vector3d(1, column, row), Eigen::Vector3d(scan.points[i].cast<double>()));
  };
  each([&](const Eigen::Vector3d& pixel, const Eigen::Vector3d& p) {
    normal += pixel * pixel.transpose();
    right += pixel * p.transpose();
  });
  const Eigen::Matrix3d linear = normal.inverse() * right;
  Eigen::Matrix3d left = Eigen::Matrix3d::Zero();
  each([&](const Eigen::Vector3d& pixel, const Eigen::Vector3d& p) {
    const Eigen::Vector3d r = p - linear.transpose() * pixel;
    left += r * r.transpose();
  });
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(left).eigenvectors().col(2);
}

/// Of the two ways to look along an axis the one from which the outline of a solid lies behind its middle.
Eigen::Vector3d towards_the_outline(const std::vector<Eigen::Vector3f>& points, const Eigen::Vector3d& axis) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& p : points) middle += p.cast<double>() / static_cast<double>(points.size());
  double mean = 0, together = 0;
  for (const auto& p : points) {
    const Eigen::Vector3d d = p.cast<double>() - middle;
    mean += (d - d.dot(axis) * axis).squaredNorm() / static_cast<double>(points.size());
  }
  for (const auto& p : points) {
    const Eigen::Vector3d d = p.cast<double>() - middle;
    together += d.dot(axis) * ((d - d.dot(axis) * axis).squaredNorm() - mean);
  }
  return together < 0 ? Eigen::Vector3d(-axis) : axis;
}

void lay_out_points(const std::vector<Eigen::Vector3f>& points, const std::optional<Eigen::Vector3d>& axis,
                    RangeSurface& s) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& p : points) middle += p.cast<double>() / static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  double reach = 0;
  for (const auto& p : points) {
    const Eigen::Vector3d d = p.cast<double>() - middle;
    spread += d * d.transpose();
    reach = std::max(reach, d.norm());
  }
  // Seen from the origin: all points lie within a cone of 50 degrees, at a fair distance.
  const Eigen::Vector3d towards = middle.stableNormalized();
  bool central = middle.norm() > 0.8 * reach;
  for (const auto& p : points)
    central = central && p.cast<double>().dot(towards) > 0.64 * p.cast<double>().norm();

  central = central && !axis;
  std::vector<View> views;
  if (axis) views.push_back({false, looking_along(towards_the_outline(points, *axis))});
  if (central) views.push_back({true, looking_along(towards)});
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
  if (views.empty())
    for (int k = 0; k < 3; ++k)
      views.push_back({false, looking_along(towards_the_outline(points, axes.eigenvectors().col(k)))});

  const auto all_rays = [&](const View& view, size_t step) {
    const Pose grid_from_sensor = view.sensor_from_grid.inverse();
    std::vector<Ray> rays;
    for (size_t i = 0; i < points.size(); i += step)
      rays.push_back(ray_of(view, grid_from_sensor, points[i]));
    return rays;
  };
  const View* best = &views.front();
  double fewest = 2;
  for (const View& view : views) {
    if (views.size() == 1) break;
    const std::vector<Ray> rays = all_rays(view, std::max<size_t>(1, points.size() / 20000));
    const double cell = cell_for(rays);
    const double hidden = hidden_fraction(rays, cell, view.central, 12 * cell);
    if (hidden < fewest) {
      fewest = hidden;
      best = &view;
    }
  }

  s.sensor_from_grid = best->sensor_from_grid;
  s.sensor_known = best->central;
  s.rays.central = best->central;
  const std::vector<Ray> rays = all_rays(*best, 1);
  const double cell = cell_for(rays);
  double min_u = 1e300, min_v = 1e300, max_u = -1e300, max_v = -1e300, min_w = 1e300;
  for (const Ray& r : rays) {
    min_u = std::min(min_u, r.u);
    max_u = std::max(max_u, r.u);
    min_v = std::min(min_v, r.v);
    max_v = std::max(max_v, r.v);
    min_w = std::min(min_w, r.w);
  }
  min_u -= kRing * cell;
  min_v -= kRing * cell;
  const double across = (max_u - min_u) / cell + 1 + kRing, down = (max_v - min_v) / cell + 1 + kRing;
  if (!(across * down <= kMostPixelsPerPoint * static_cast<double>(points.size()) + kFewPixels))
    throw InputError("scan " + s.name + ": its " + std::to_string(points.size()) +
                     " points lie so far apart that a grid for them would have " +
                     std::to_string(std::llround(across)) + " x " + std::to_string(std::llround(down)) +
                     " pixels; are there stray points? Cut them off with a crop box");
  s.width = static_cast<int>(across);
  s.height = static_cast<int>(down);
  // Pixel (0, 0) is centred half a cell inside the rectangle.
  const double u0 = min_u + 0.5 * cell, v0 = min_v + 0.5 * cell;
  s.rays.ray_of_pixel.setZero();
  s.rays.ray_of_pixel.leftCols<3>() << u0, cell, 0, v0, 0, cell;
  s.rays.pixel_of_ray.setZero();
  s.rays.pixel_of_ray.leftCols<3>() << -u0 / cell, 1 / cell, 0, -v0 / cell, 0, 1 / cell;
  if (!s.rays.central) {  // depth counts from a little in front, so that 0 can mean nothing
    const double shift = min_w - 1;
    s.sensor_from_grid = s.sensor_from_grid * Eigen::Translation3d(0, 0, shift);
  }
  const double w_shift = s.rays.central ? 0 : min_w - 1;

  s.w.assign(static_cast<size_t>(s.width) * s.height, 0.0f);
  s.flags.assign(s.w.size(), 0);
  const auto pixel_of = [&](const Ray& r) {
    const int column = std::clamp(static_cast<int>((r.u - min_u) / cell), 0, s.width - 1);
    const int row = std::clamp(static_cast<int>((r.v - min_v) / cell), 0, s.height - 1);
    return s.index(column, row);
  };
  // "Nearer" is larger for 1 / z and smaller for z.
  const auto nearer = [&](double a, double b) { return s.rays.central ? a > b : a < b; };
  std::vector<float> front(s.w.size(), 0);
  for (const Ray& r : rays) {
    float& f = front[pixel_of(r)];
    const auto w = static_cast<float>(r.w - w_shift);
    if (f == 0 || nearer(w, f)) f = w;
  }
  // Points of the front layer, corrected for where in their pixel they lie once the slope is known.
  const double layer = 8 * cell;  // in units of depth per ray
  const auto in_front_layer = [&](const Ray& r, size_t pixel) {
    const double w = r.w - w_shift, f = front[pixel];
    return s.rays.central ? f - w < layer * f : w - f < layer;
  };
  std::vector<float> slope_u(s.w.size(), 0), slope_v(s.w.size(), 0);
  std::vector<float> sum(s.w.size()), count(s.w.size());
  for (int pass = 0; pass < 2; ++pass) {
    std::fill(sum.begin(), sum.end(), 0.0f);
    std::fill(count.begin(), count.end(), 0.0f);
    s.dropped_hidden = 0;
    for (const Ray& r : rays) {
      const size_t i = pixel_of(r);
      if (!in_front_layer(r, i)) {
        ++s.dropped_hidden;
        continue;
      }
      const int column = static_cast<int>(i % s.width), row = static_cast<int>(i / s.width);
      const double du = (r.u - u0) / cell - column, dv = (r.v - v0) / cell - row;
      // Summed relative to the front, which keeps all digits.
      sum[i] += static_cast<float>(r.w - w_shift - front[i] - slope_u[i] * du - slope_v[i] * dv);
      count[i] += 1;
    }
    for (size_t i = 0; i < s.w.size(); ++i) {
      s.w[i] = count[i] > 0 ? front[i] + sum[i] / count[i] : 0.0f;
      s.flags[i] = count[i] > 0 ? RangeSurface::kSeen : 0;
    }
    if (pass == 0)
      fit_windows(s.w, s.width, s.height, 3, [&](int row, const WindowFit& fit) {
        for (int column = 0; column < s.width; ++column) {
          const size_t i = s.index(column, row);
          if (fit.count[column] < 8) continue;
          slope_u[i] = fit.column_slope[column];
          slope_v[i] = fit.row_slope[column];
        }
      });
  }
}

}  // namespace

bool lay_out(const Scan& scan, const std::vector<unsigned char>& keep, RangeSurface& surface) {
  if (scan.organised() && lay_out_grid(scan, keep, surface)) return true;
  std::vector<Eigen::Vector3f> points;
  for (size_t i = 0; i < keep.size(); ++i)
    if (keep[i]) points.push_back(scan.points[i]);
  std::optional<Eigen::Vector3d> axis;
  if (scan.organised()) axis = viewing_axis(scan, keep);
  lay_out_points(points, axis, surface);
  return false;
}

}  // namespace gantry::internal
