#include "local_surface.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr size_t kLeastForPlane = 4;      ///< Points, the one itself included.
constexpr size_t kLeastForQuadratic = 9;  ///< Six coefficients and some redundancy.
constexpr double kScatterLimit =
    2.0;  ///< Reduced chi-square above which a plane does not describe the neighbours.
constexpr double kEdgeScatter =
    5.0;  ///< ... and above which no smooth surface does: the point lies on an edge.
/// Neighbours whose centroid is this far off (fraction of the radius) lie to one side; 0.42 at a straight
/// rim.
constexpr double kLopsided = 0.2;

struct Sample {
  double u, v, height;  // u, v across the normal in units of the radius; height along it in mm
  double weight;
};

struct Fit {
  double height = 0;    // at (0, 0)
  double variance = 0;  // of that
  double scatter = 0;   // reduced chi-square ...
  double freedoms = 1;  // ... of so many degrees of freedom
  bool valid = false;
};

template <int N>
Fit fit_polynomial(const std::vector<Sample>& samples) {
  using Row = Eigen::Matrix<double, N, 1>;
  const auto row_of = [](const Sample& s) {
    Row row;
    if constexpr (N == 3) {
      row << 1, s.u, s.v;
    } else {
      row << 1, s.u, s.v, s.u * s.u, s.u * s.v, s.v * s.v;
    }
    return row;
  };
  Eigen::Matrix<double, N, N> normal = Eigen::Matrix<double, N, N>::Zero();
  Row right = Row::Zero();
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();
  for (const Sample& s : samples) {
    const Row row = row_of(s);
    normal += s.weight * row * row.transpose();
    right += s.weight * s.height * row;
    low = std::min(low, s.height);
    high = std::max(high, s.height);
  }
  Fit fit;
  const Eigen::LDLT<Eigen::Matrix<double, N, N>> solver(normal);
  if (solver.info() != Eigen::Success || solver.rcond() < 1e-6) return fit;  // the samples lie in a line
  const Row solution = solver.solve(right);
  double chi = 0;
  for (const Sample& s : samples) {
    const double residual = s.height - solution.dot(row_of(s));
    chi += s.weight * residual * residual;
  }
  fit.height = std::clamp(solution(0), low, high);
  fit.variance = solver.solve(Row(Row::Unit(0)))(0);
  fit.freedoms = std::max<double>(1.0, static_cast<double>(samples.size()) - N);
  fit.scatter = chi / fit.freedoms;
  fit.valid = true;
  return fit;
}

/// Median of a quantity over up to 5000 of the points, spread evenly.
template <typename Function>
double median_over(size_t count, Function&& value) {
  std::vector<double> values;
  for (size_t i = 0; i < count; i += std::max<size_t>(1, count / 5000)) values.push_back(value(i));
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Normal of unknown sign through neighbours, for clouds that bring none.
Eigen::Vector3f neighbours_normal(const PointCloud& cloud, const std::vector<PointIndex::Neighbour>& near) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& n : near) mean += cloud.points[n.index].cast<double>();
  mean /= static_cast<double>(near.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const auto& n : near) {
    const Eigen::Vector3d d = cloud.points[n.index].cast<double>() - mean;
    covariance += d * d.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  return solver.eigenvectors().col(0).cast<float>();
}

}  // namespace

LocalSurface fit_local_surface(const PointCloud& cloud, double radius_mm, double systematic_sigma_mm) {
  const size_t n = cloud.size();
  const PointIndex index(cloud.points);
  const double spacing = median_over(n, [&](size_t i) {
    std::vector<PointIndex::Neighbour> two;
    index.nearest(cloud.points[i], 2, 1e9f, two);
    return std::sqrt(two.back().squared_distance);
  });
  const double radius = std::max(radius_mm, 2 * spacing);
  LocalSurface surface;
  surface.points = cloud.points;
  surface.sigma_mm.assign(n, 0);
  surface.supported.assign(n, 0);
  surface.rim.assign(n, 0);
  surface.spacing_mm = spacing;
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    thread_local std::vector<PointIndex::Neighbour> near;
    thread_local std::vector<Sample> samples;
    index.within(cloud.points[i], static_cast<float>(radius), near);
    if (near.size() < kLeastForPlane) return;
    // In a fixed order, so that sums do not depend on how the index was built.
    std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
    const Eigen::Vector3f normal = cloud.has_normals() ? cloud.normals[i] : neighbours_normal(cloud, near);
    const Eigen::Vector3f across_u = normal.unitOrthogonal(), across_v = normal.cross(across_u);
    samples.clear();
    for (const auto& each : near) {
      const size_t j = each.index;
      if (cloud.has_normals() && normal.dot(cloud.normals[j]) < 0.5f) continue;
      const Eigen::Vector3f d = cloud.points[j] - cloud.points[i];
      const double sigma = cloud.has_sigma() ? std::hypot(cloud.sigma_mm[j], systematic_sigma_mm) : 1.0;
      samples.push_back(
          {across_u.dot(d) / radius, across_v.dot(d) / radius, normal.dot(d), 1.0 / (sigma * sigma)});
    }
    if (samples.size() < kLeastForPlane) return;
    double middle_u = 0, middle_v = 0;
    for (const Sample& s : samples) {
      middle_u += s.u / static_cast<double>(samples.size());
      middle_v += s.v / static_cast<double>(samples.size());
    }
    surface.rim[i] = std::hypot(middle_u, middle_v) > kLopsided;
    Fit fit = fit_polynomial<3>(samples);
    if (!fit.valid) return;
    // A cloud that does not state its noise is taken at its scatter; there is then nothing to compare it
    // with.
    const bool structured = !cloud.has_sigma() || fit.scatter > kScatterLimit;
    if (structured && samples.size() >= kLeastForQuadratic) {
      const Fit curved = fit_polynomial<6>(samples);
      if (curved.valid) fit = curved;
    }
    if (cloud.has_sigma() && fit.scatter > kEdgeScatter) return;
    surface.points[i] += static_cast<float>(fit.height) * normal;
    // Two standard deviations of scatter are chance, and to take them for shape would overstate the rest.
    const double by_chance = 1 + 2 * std::sqrt(2 / fit.freedoms);
    const double unmodelled = cloud.has_sigma() ? std::max(1.0, fit.scatter / by_chance) : fit.scatter;
    surface.sigma_mm[i] = static_cast<float>(std::sqrt(fit.variance * unmodelled));
    surface.supported[i] = 1;
  });
  return surface;
}

}  // namespace gantry::internal
