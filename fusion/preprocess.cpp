#include "gantry/fusion/preprocess.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "gantry/foundation/error.h"
#include "gantry/geometry/point_index.h"

namespace gantry {
namespace {

/// Neighbours further apart than this many pixel pitches belong to different surfaces. A continuous
/// surface reaches it only beyond 75 degrees of incidence, where there is little to measure.
constexpr double kStepInPitches = 4.0;
/// A point further than this many times the local noise from its neighbours' plane is an outlier.
constexpr double kOutlierInSigmas = 4.0;
constexpr size_t kMinPoints = 100;
/// Closer to edge-on than 80 degrees neither side nor position of a surface is certain.
constexpr float kGrazingCosine = 0.17f;

template <typename T>
T median(std::vector<T> values) {
  if (values.empty()) return T{};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Plane through points given as a sum, by principal components.
struct PlaneFit {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  int count = 0;

  void add(const Eigen::Vector3d& p) {
    sum += p;
    squares += p * p.transpose();
    ++count;
  }
  /// Unit normal of unknown sign; `rms` is the points' distance from the plane, corrected for the fit.
  Eigen::Vector3d solve(double& rms) const {
    const Eigen::Vector3d mean = sum / count;
    const Eigen::Matrix3d covariance = squares / count - mean * mean.transpose();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(covariance);
    rms = std::sqrt(std::max(0.0, solver.eigenvalues()(0)) * count / std::max(1, count - 3));
    return solver.eigenvectors().col(0);
  }
};

/// What is known of each point of the scan while it is being worked on.
struct Work {
  std::vector<Eigen::Vector3f> normal;
  std::vector<float> rms;
  std::vector<unsigned char> keep, rim;
  explicit Work(size_t n) : normal(n, Eigen::Vector3f::Zero()), rms(n, 0), keep(n, 0), rim(n, 0) {}
};

std::vector<unsigned char> crop(const TaggedScan& tagged, const PreprocessOptions& options,
                                ScanSurface& out) {
  const Scan& scan = tagged.scan;
  std::vector<unsigned char> valid(scan.points.size(), 0);
  const Pose& pose = tagged.part_from_sensor.mean;
  for (size_t i = 0; i < valid.size(); ++i) {
    if (!scan.valid(i)) continue;
    ++out.measured;
    valid[i] = !options.crop_part_mm || options.crop_part_mm->contains(pose * scan.points[i].cast<double>());
    out.dropped_crop += !valid[i];
  }
  return valid;
}

/// Median distance between neighbours along rows or along columns, whichever is larger: line scanners
/// often measure more densely along their line.
double grid_spacing(const Scan& scan, const std::vector<unsigned char>& valid) {
  std::vector<float> along_row, along_column;
  for (int row = 0; row + 1 < scan.height; row += 3) {
    for (int column = 0; column + 1 < scan.width; column += 3) {
      const size_t i = scan.index(column, row), right = i + 1, below = scan.index(column, row + 1);
      if (!valid[i]) continue;
      if (valid[right]) along_row.push_back((scan.points[i] - scan.points[right]).norm());
      if (valid[below]) along_column.push_back((scan.points[i] - scan.points[below]).norm());
    }
  }
  return std::max(median(std::move(along_row)), median(std::move(along_column)));
}

/// Least-squares fit of a quantity of each point (a 3-vector) that should be linear in column and row;
/// returns the covariance of what is left over and, by `spread`, that of the quantity itself.
template <typename Quantity>
Eigen::Matrix3d left_over_by_linear_fit(const Scan& scan, const Work& work, Quantity&& quantity,
                                        Eigen::Matrix3d& spread) {
  const auto each_point = [&](auto&& visit) {
    for (int row = 0; row < scan.height; ++row)
      for (int column = 0; column < scan.width; ++column)
        if (const size_t i = scan.index(column, row); work.keep[i])
          visit(Eigen::Vector3d(1, static_cast<double>(column) / scan.width,
                                static_cast<double>(row) / scan.height),
                Eigen::Vector3d(quantity(Eigen::Vector3d(scan.points[i].cast<double>()))));
  };
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero(), right = Eigen::Matrix3d::Zero();
  each_point([&](const Eigen::Vector3d& pixel, const Eigen::Vector3d& value) {
    normal += pixel * pixel.transpose();
    right += pixel * value.transpose();
  });
  const Eigen::Matrix3d linear = normal.ldlt().solve(right);
  const double count = std::max(1.0, normal(0, 0));
  const Eigen::Vector3d mean = right.row(0).transpose() / count;
  Eigen::Matrix3d left_over = Eigen::Matrix3d::Zero();
  spread.setZero();
  each_point([&](const Eigen::Vector3d& pixel, const Eigen::Vector3d& value) {
    const Eigen::Vector3d residual = value - linear.transpose() * pixel;
    left_over += residual * residual.transpose() / count;
    spread += (value - mean) * (value - mean).transpose() / count;
  });
  return left_over;
}

/// Whether the rays meet at the origin as a camera's do: x / z and y / z are then linear in column and row.
bool rays_meet_at_origin(const Scan& scan, const Work& work) {
  Eigen::Matrix3d spread;
  const Eigen::Matrix3d left_over = left_over_by_linear_fit(
      scan, work, [](const Eigen::Vector3d& p) { return Eigen::Vector3d(p.x() / p.z(), p.y() / p.z(), 0); },
      spread);
  return left_over.trace() < 1e-3 * spread.trace();
}

/// Direction of the rays of a scan whose rays are about parallel, such as a line scanner's on a stage:
/// positions across the rays are linear in row and column, so what the fit leaves over lies along them.
/// Sign unknown.
Eigen::Vector3d parallel_ray_direction(const Scan& scan, const Work& work) {
  Eigen::Matrix3d spread;
  const Eigen::Matrix3d left_over = left_over_by_linear_fit(
      scan, work, [](const Eigen::Vector3d& p) { return p; }, spread);
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(left_over).eigenvectors().col(2);
}

/// Turns the normals towards the sensor. In this frame the sensor is at the origin, so every surface it
/// saw faces the origin. Scans of other devices may have their origin anywhere: then the direction of
/// the rays, and the handedness of the grid (columns to the right, rows down), tell the side.
void orient(const Scan& scan, Work& work) {
  const bool sensor_at_origin = rays_meet_at_origin(scan, work);
  Eigen::Vector3d back_along_rays = Eigen::Vector3d::UnitZ();
  if (!sensor_at_origin) {
    Eigen::Vector3d outwards = Eigen::Vector3d::Zero();
    for (int row = 0; row + 1 < scan.height; ++row) {
      for (int column = 0; column + 1 < scan.width; ++column) {
        const size_t i = scan.index(column, row), right = i + 1, below = scan.index(column, row + 1);
        if (!work.keep[i] || !work.keep[right] || !work.keep[below]) continue;
        outwards +=
            (scan.points[below] - scan.points[i]).cross(scan.points[right] - scan.points[i]).cast<double>();
      }
    }
    back_along_rays = parallel_ray_direction(scan, work);
    if (back_along_rays.dot(outwards) < 0) back_along_rays *= -1;
  }
  for (size_t i = 0; i < work.normal.size(); ++i) {
    if (!work.keep[i]) continue;
    const Eigen::Vector3f to_sensor = sensor_at_origin ? Eigen::Vector3f(-scan.points[i].stableNormalized())
                                                       : back_along_rays.cast<float>().eval();
    const float cosine = work.normal[i].dot(to_sensor);
    if (cosine < 0) work.normal[i] *= -1;
    if (std::abs(cosine) < kGrazingCosine) work.keep[i] = 0;
  }
}

void work_on_grid(const Scan& scan, const std::vector<unsigned char>& valid, const PreprocessOptions& options,
                  ScanSurface& out, Work& work) {
  const int w = scan.width, h = scan.height;
  out.spacing_mm = grid_spacing(scan, valid);
  const float step = static_cast<float>(kStepInPitches * out.spacing_mm);

  // Depth steps: both sides of a step are suspect, and their surroundings.
  std::vector<unsigned char> at_step(valid.size(), 0);
  tbb::parallel_for(0, h, [&](int row) {
    for (int column = 0; column < w; ++column) {
      const size_t i = scan.index(column, row);
      if (!valid[i]) continue;
      for (int dr = -1; dr <= 1 && !at_step[i]; ++dr) {
        for (int dc = -1; dc <= 1; ++dc) {
          const int c = column + dc, r = row + dr;
          if (c < 0 || r < 0 || c >= w || r >= h) continue;
          const size_t j = scan.index(c, r);
          if (valid[j] && (scan.points[i] - scan.points[j]).squaredNorm() > step * step) {
            at_step[i] = 1;
            break;
          }
        }
      }
    }
  });

  tbb::parallel_for(0, h, [&](int row) {
    const int m = options.edge_margin_px, n = options.normal_window_px;
    for (int column = 0; column < w; ++column) {
      const size_t i = scan.index(column, row);
      if (!valid[i]) continue;
      bool near_step = false;
      for (int r = std::max(0, row - m); r <= std::min(h - 1, row + m) && !near_step; ++r)
        for (int c = std::max(0, column - m); c <= std::min(w - 1, column + m); ++c)
          near_step = near_step || at_step[scan.index(c, r)];
      if (near_step) continue;

      const Eigen::Vector3f centre = scan.points[i];
      // The window's corner on a surface seen at 75 degrees of incidence; beyond lies another surface.
      const float reach = static_cast<float>(n) * step;
      PlaneFit fit;
      for (int r = std::max(0, row - n); r <= std::min(h - 1, row + n); ++r) {
        for (int c = std::max(0, column - n); c <= std::min(w - 1, column + n); ++c) {
          const size_t j = scan.index(c, r);
          if (!valid[j] || at_step[j]) continue;
          const Eigen::Vector3f d = scan.points[j] - centre;
          if (d.squaredNorm() < reach * reach) fit.add(d.cast<double>());
        }
      }
      const double fill = static_cast<double>(fit.count) / ((2 * n + 1) * (2 * n + 1));
      if (fit.count < 6) continue;
      double rms = 0;
      const Eigen::Vector3d normal = fit.solve(rms);
      const double distance = std::abs(normal.dot(fit.sum / fit.count));
      if (distance > kOutlierInSigmas * rms) continue;
      work.normal[i] = normal.cast<float>();
      work.rms[i] = static_cast<float>(rms);
      work.rim[i] = fill < options.min_window_fill;
      work.keep[i] = 1;
    }
  });

  orient(scan, work);
}

void work_on_neighbours(const Scan& scan, const std::vector<unsigned char>& valid,
                        const PreprocessOptions& options, ScanSurface& out, Work& work) {
  std::vector<Eigen::Vector3f> points;
  std::vector<size_t> origin;
  for (size_t i = 0; i < valid.size(); ++i) {
    if (!valid[i]) continue;
    points.push_back(scan.points[i]);
    origin.push_back(i);
  }
  if (points.size() < kMinPoints) return;
  const PointIndex index(points);
  std::vector<float> steps(points.size()), mean_distance(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t p) {
    thread_local std::vector<PointIndex::Neighbour> found;
    index.nearest(points[p], options.normal_neighbours, 1e9f, found);
    PlaneFit fit;
    float sum = 0;
    Eigen::Vector3f lopsided = Eigen::Vector3f::Zero();
    for (const auto& n : found) {
      fit.add((points[n.index] - points[p]).cast<double>());
      lopsided += points[n.index] - points[p];
      sum += std::sqrt(n.squared_distance);
    }
    double rms = 0;
    Eigen::Vector3d normal = fit.solve(rms);
    if (normal.dot(points[p].cast<double>()) > 0) normal *= -1;
    const size_t i = origin[p];
    work.normal[i] = normal.cast<float>();
    work.rms[i] = static_cast<float>(rms);
    steps[p] = found.size() > 1 ? std::sqrt(found[1].squared_distance) : 0;
    mean_distance[p] = sum / static_cast<float>(found.size());
    // At the rim all neighbours lie to one side.
    work.rim[i] = lopsided.norm() > 0.5f * sum;
    work.keep[i] = std::abs(normal.dot(fit.sum / fit.count)) <= kOutlierInSigmas * rms;
  });
  out.spacing_mm = median(steps);
  const float usual = median(mean_distance);
  for (size_t p = 0; p < points.size(); ++p)
    if (mean_distance[p] > 4 * usual) work.keep[origin[p]] = 0;
}

}  // namespace

ScanSurface preprocess(const TaggedScan& tagged, const PreprocessOptions& options) {
  const Scan& scan = tagged.scan;
  ScanSurface out;
  out.name = tagged.name;
  out.part_from_sensor = tagged.part_from_sensor;
  const std::vector<unsigned char> valid = crop(tagged, options, out);
  Work work(scan.points.size());
  if (scan.organised()) {
    work_on_grid(scan, valid, options, out, work);
  } else {
    work_on_neighbours(scan, valid, options, out, work);
  }

  // The noise model: triangulation noise along the ray grows with the square of the distance and with
  // 1 / cos(incidence); along the normal, which is what counts here, the cosine cancels. Only the scale
  // is taken from this scan.
  const auto shape = [&](size_t i) { return std::max(scan.points[i].squaredNorm(), 1e-6f); };
  std::vector<float> scales;
  for (size_t i = 0; i < valid.size(); ++i)
    if (work.keep[i] && !work.rim[i]) scales.push_back(work.rms[i] / shape(i));
  const float scale = median(std::move(scales));

  std::vector<float> sigmas;
  const size_t inside = out.measured - out.dropped_crop;
  for (size_t i = 0; i < valid.size(); ++i) {
    if (!work.keep[i]) continue;
    const float sigma = scale * shape(i);
    out.cloud.points.push_back(scan.points[i]);
    out.cloud.normals.push_back(work.normal[i]);
    out.cloud.sigma_mm.push_back(std::max(sigma, 1e-6f));
    out.rim.push_back(work.rim[i]);
    sigmas.push_back(sigma);
  }
  out.dropped_edges = inside - out.cloud.size();
  out.noise_mm = median(std::move(sigmas));
  if (out.cloud.size() < kMinPoints)
    throw InputError("scan " + tagged.name + ": only " + std::to_string(out.cloud.size()) + " of " +
                     std::to_string(out.measured) + " measured points are left after cropping (" +
                     std::to_string(out.dropped_crop) +
                     " outside the part's volume) and filtering; at least " + std::to_string(kMinPoints) +
                     " are needed");
  return out;
}

}  // namespace gantry
