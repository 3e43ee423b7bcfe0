#include "gantry/fusion/preprocess.h"

#include <tbb/parallel_for.h>

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

std::vector<unsigned char> crop(const TaggedScan& tagged, const PreprocessOptions& options, ScanSurface& out) {
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

double grid_spacing(const Scan& scan, const std::vector<unsigned char>& valid) {
  std::vector<float> steps;
  for (int row = 0; row < scan.height; row += 3) {
    for (int column = 0; column + 1 < scan.width; column += 3) {
      const size_t i = scan.index(column, row);
      if (valid[i] && valid[i + 1]) steps.push_back((scan.points[i] - scan.points[i + 1]).norm());
    }
  }
  return median(std::move(steps));
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

  // Sign: the grid's handedness (columns to the right, rows down) makes it consistent over the scan.
  size_t towards = 0, total = 0;
  for (int row = 0; row + 1 < h; ++row) {
    for (int column = 0; column + 1 < w; ++column) {
      const size_t i = scan.index(column, row);
      if (!work.keep[i]) continue;
      Eigen::Vector3f right = Eigen::Vector3f::Zero(), down = Eigen::Vector3f::Zero();
      for (int k = 1; k <= 3 && (right.isZero() || down.isZero()); ++k) {
        if (right.isZero() && column + k < w && valid[i + k]) right = scan.points[i + k] - scan.points[i];
        if (down.isZero() && row + k < h && valid[scan.index(column, row + k)])
          down = scan.points[scan.index(column, row + k)] - scan.points[i];
      }
      const float side = down.cross(right).dot(work.normal[i]);
      if (side == 0 || right.squaredNorm() > 9 * step * step || down.squaredNorm() > 9 * step * step) {
        work.keep[i] = 0;
        continue;
      }
      if (side < 0) work.normal[i] *= -1;
      ++total;
      towards += work.normal[i].dot(scan.points[i]) < 0;
    }
  }
  for (int row = 0; row < h; ++row) work.keep[scan.index(w - 1, row)] = 0;
  for (int column = 0; column < w; ++column) work.keep[scan.index(column, h - 1)] = 0;
  // Where the sensor is at the origin, as this frame says, every surface it sees faces the origin. Then
  // that decides the sign, and not the order in which the file lists rows and columns, nor the noise of
  // two neighbours at grazing incidence. Scans of other devices may have their origin anywhere.
  const double fraction = total ? static_cast<double>(towards) / static_cast<double>(total) : 1.0;
  if (fraction < 0.1 || fraction > 0.9)
    for (size_t i = 0; i < work.normal.size(); ++i)
      if (work.normal[i].dot(scan.points[i]) > 0) work.normal[i] *= -1;
}

void work_on_neighbours(const Scan& scan, const std::vector<unsigned char>& valid, const PreprocessOptions& options,
                        ScanSurface& out, Work& work) {
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

  // The noise model: sigma grows with the square of the distance and with 1 / cos(incidence); only its
  // scale is taken from this scan. Frontal points serve, where curvature in the window matters least.
  const auto shape = [&](size_t i) {
    const float distance = scan.points[i].norm();
    const float cosine = std::abs(work.normal[i].dot(scan.points[i])) / std::max(distance, 1e-6f);
    return std::max(distance * distance, 1e-6f) / std::max(cosine, 0.1f);
  };
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
                     std::to_string(out.dropped_crop) + " outside the part's volume) and filtering; at least " +
                     std::to_string(kMinPoints) + " are needed");
  return out;
}

}  // namespace gantry
