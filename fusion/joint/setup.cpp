#include "joint/setup.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr int kCoarsestStep = 16;
constexpr size_t kCoarsePoints = 200;

template <typename T>
T median_of(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// How much noise tilts a normal about each axis across it: variance of the slope of a plane fitted to a
/// window of n x n pixels without the inner nine (grid_normals.h).
double normal_variance_of(const RangeSurface& s) {
  const double n = 2 * s.normal_window_px + 1;
  const double spread = n * n * (n * n - 1) / 12 - 6;
  return std::pow(s.noise_mm / s.spacing_mm, 2) / spread;
}

void place_centre(JointProblem& problem) {
  std::vector<Eigen::Vector3d> places;
  for (size_t i = 0; i < problem.size(); ++i)
    for (const int k : problem.coarse_levels[i].filled)
      places.push_back(problem.scans[i].part_from_grid() * problem.coarse_levels[i].point(k).cast<double>());
  if (places.empty()) return;
  for (const Eigen::Vector3d& p : places) problem.centre += p / static_cast<double>(places.size());
  std::vector<double> distances;
  for (const Eigen::Vector3d& p : places) distances.push_back((p - problem.centre).norm());
  std::sort(distances.begin(), distances.end());
  problem.radius_mm = std::max(1e-3, distances[distances.size() * 9 / 10]);
}

/// The coarsest level is as coarse as leaves enough points to most scans.
void make_levels(JointProblem& problem) {
  const size_t n = problem.size();
  problem.coarse_levels.resize(n);
  problem.medium_levels.resize(n);
  int step = kCoarsestStep;
  for (; step >= 2; step /= 2) {
    tbb::parallel_for(size_t{0}, n,
                      [&](size_t i) { problem.coarse_levels[i] = make_level(problem.scans[i], step); });
    std::vector<size_t> points;
    for (const CoarseLevel& level : problem.coarse_levels) points.push_back(level.filled.size());
    if (step == 2 || median_of(points) >= kCoarsePoints) break;
  }
  tbb::parallel_for(size_t{0}, n,
                    [&](size_t i) { problem.medium_levels[i] = make_level(problem.scans[i], step / 2); });
  std::vector<double> coarse, medium;
  for (size_t i = 0; i < n; ++i) {
    coarse.push_back(problem.coarse_levels[i].spacing_mm);
    medium.push_back(problem.medium_levels[i].spacing_mm);
  }
  problem.coarse_mm = median_of(coarse);
  problem.medium_mm = median_of(medium);
}

}  // namespace

JointProblem make_problem(std::span<const RangeSurface> scans, const JointOptions& options) {
  JointProblem problem;
  problem.scans = scans;
  const size_t n = scans.size();
  make_levels(problem);
  std::vector<double> noise, spacing, tilts;
  for (size_t i = 0; i < n; ++i) {
    problem.coarse.levels.push_back(&problem.coarse_levels[i]);
    problem.medium.levels.push_back(&problem.medium_levels[i]);
    problem.coarse.rays.push_back(&scans[i].rays);
    problem.medium.rays.push_back(&scans[i].rays);
    noise.push_back(scans[i].noise_mm);
    spacing.push_back(scans[i].spacing_mm);
    tilts.push_back(normal_variance_of(scans[i]));
  }
  place_centre(problem);
  for (const RangeSurface& s : scans) problem.edges.emplace_back(s);
  problem.noise_mm = options.noise_mm > 0 ? options.noise_mm : median_of(noise);
  problem.spacing_mm = median_of(spacing);
  problem.normal_variance = median_of(tilts) / 2;  // the mean of two normals
  if (options.max_partners > 0) problem.max_partners = options.max_partners;
  problem.tag_prior = TagPrior(scans, problem.centre);
  for (size_t i = 0; i < n; ++i)
    problem.priors.push_back({scans[i].part_from_grid(), problem.tag_prior.information_of(i)});
  return problem;
}

double tag_sigma_mm(const JointProblem& problem) {
  double largest = 0;
  Vector6d unit;
  unit << Eigen::Vector3d::Constant(problem.radius_mm), Eigen::Vector3d::Ones();
  for (const PosePrior& prior : problem.priors) {
    const Matrix6d covariance = prior.information.inverse();
    const Matrix6d scaled = unit.asDiagonal() * covariance * unit.asDiagonal();
    largest = std::max(largest, std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(5)));
  }
  return largest;
}

}  // namespace gantry::internal
