#include "gantry/fusion/gicp.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

namespace gantry {
namespace {

/// Normal-space sampling (Rusinkiewicz and Levoy 2001): every direction of the surface gets its say, so
/// that a small flange still holds a large plate in place. Deterministic.
std::vector<uint32_t> sample_by_normals(const PointCloud& cloud, size_t samples) {
  std::map<int, std::vector<uint32_t>> bins;
  for (uint32_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& n = cloud.normals[i];
    const auto cell = [](float x) { return std::clamp(static_cast<int>((x + 1.0f) * 2.5f), 0, 4); };
    bins[cell(n.x()) * 25 + cell(n.y()) * 5 + cell(n.z())].push_back(i);
  }
  std::mt19937 random(1);
  std::vector<uint32_t> chosen;
  // Small bins give all they have; what they leave is shared among the larger ones.
  std::vector<std::vector<uint32_t>*> order;
  for (auto& [key, members] : bins) order.push_back(&members);
  std::stable_sort(order.begin(), order.end(), [](auto* a, auto* b) { return a->size() < b->size(); });
  size_t left = std::min(samples, cloud.size());
  for (size_t b = 0; b < order.size(); ++b) {
    std::vector<uint32_t>& members = *order[b];
    const size_t take = std::min(members.size(), left / (order.size() - b));
    for (size_t k = 0; k < take; ++k) {
      std::uniform_int_distribution<size_t> rest(k, members.size() - 1);
      std::swap(members[k], members[rest(random)]);
      chosen.push_back(members[k]);
    }
    left -= take;
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

/// A step of which the square, in units of the pose's own covariance, is below this changes nothing that is
/// known.
constexpr double kInsignificantStep = 1e-3;
/// Matches may flicker between equally near points for ever; within one standard deviation that is no harm.
constexpr double kFlickerStep = 1.0;

struct Match {
  Eigen::Vector3d point;     // source point in the target frame
  Eigen::Vector3d residual;  // target point - point
  Eigen::Matrix3d weight;    // inverse covariance of the residual
  double along_normal = 0;   // distance along the common normal
  double sigma = 0;          // of that distance
  bool found = false;
};

/// Covariance of a point on a locally plane surface: noise along the normal, spacing across.
Eigen::Matrix3d surface_covariance(const Eigen::Vector3d& normal, double sigma_mm, double spacing_mm) {
  const Eigen::Matrix3d nn = normal * normal.transpose();
  return sigma_mm * sigma_mm * nn + spacing_mm * spacing_mm * (Eigen::Matrix3d::Identity() - nn);
}

}  // namespace

GicpResult register_pair(const GicpTarget& target, const ScanSurface& source,
                         const Pose& initial_target_from_source, const GicpOptions& options) {
  const ScanSurface& to = target.surface();
  const std::vector<uint32_t> samples = sample_by_normals(source.cloud, options.samples);
  const double end_mm =
      options.min_distance_mm > 0 ? options.min_distance_mm : 4 * std::max(to.spacing_mm, source.spacing_mm);
  const double min_cosine = std::cos(options.max_angle_rad);
  // Across the surface a match says nothing finer than the spacing; tangential freedom is what lets
  // surfaces slide into place, so it is generous.
  const double across_to = 10 * to.spacing_mm, across_from = 10 * source.spacing_mm;

  GicpResult result;
  result.target_from_source = initial_target_from_source;
  double radius_mm = std::max(options.max_distance_mm, end_mm);
  std::vector<Match> matches(samples.size());

  const auto find_matches = [&](double reach_mm) {
    const Pose pose = result.target_from_source;
    tbb::parallel_for(tbb::blocked_range<size_t>(0, samples.size(), 256), [&](const auto& range) {
      std::vector<PointIndex::Neighbour> nearest;
      for (size_t s = range.begin(); s < range.end(); ++s) {
        Match& match = matches[s];
        match.found = false;
        const uint32_t i = samples[s];
        const Eigen::Vector3d p = pose * source.cloud.points[i].cast<double>();
        const Eigen::Vector3d n = pose.linear() * source.cloud.normals[i].cast<double>();
        target.index().nearest(p.cast<float>(), 1, static_cast<float>(reach_mm), nearest);
        if (nearest.empty()) continue;
        const uint32_t j = nearest[0].index;
        if (to.rim[j]) continue;
        const Eigen::Vector3d m = to.cloud.normals[j].cast<double>();
        if (m.dot(n) < min_cosine) continue;
        match.point = p;
        match.residual = to.cloud.points[j].cast<double>() - p;
        const double sigma_to = to.cloud.sigma_mm[j], sigma_from = source.cloud.sigma_mm[i];
        match.weight =
            (surface_covariance(m, sigma_to, across_to) + surface_covariance(n, sigma_from, across_from))
                .inverse();
        const Eigen::Vector3d common = (m + n).normalized();
        match.along_normal = common.dot(match.residual);
        match.sigma = std::hypot(sigma_to, sigma_from);
        match.found = true;
      }
    });
  };

  const auto robust_scale = [&] {
    std::vector<double> size;
    for (const Match& m : matches)
      if (m.found) size.push_back(std::abs(m.along_normal) / m.sigma);
    if (size.empty()) return 1.0;
    const auto middle = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2);
    std::nth_element(size.begin(), middle, size.end());
    return std::max(1.0, 1.4826 * *middle);
  };

  Matrix6d hessian = Matrix6d::Zero();
  double scale = 1e300;
  for (result.iterations = 1; result.iterations <= options.max_iterations; ++result.iterations) {
    find_matches(radius_mm);
    // Only ever narrower: a scale that follows every change of the matches would make them oscillate.
    scale = std::min(scale, 3.0 * robust_scale());
    hessian.setZero();
    Vector6d gradient = Vector6d::Zero();
    size_t found = 0;
    for (const Match& m : matches) {
      if (!m.found) continue;
      ++found;
      const double r = m.along_normal / (m.sigma * scale);
      const double loss_weight = 1.0 / ((1 + r * r) * (1 + r * r));  // Geman-McClure
      Eigen::Matrix<double, 3, 6> j;
      j << -cross_matrix(m.point), Eigen::Matrix3d::Identity();
      const Eigen::Matrix<double, 6, 3> jw = loss_weight * j.transpose() * m.weight;
      hessian += jw * j;
      gradient += jw * m.residual;
    }
    if (found < 20) return result;
    // The damping is far below what any real constraint contributes; it only keeps a slide finite.
    const Vector6d diagonal = hessian.diagonal();
    Matrix6d damped = hessian;
    damped.diagonal() += 1e-9 * diagonal + Vector6d::Constant(1e-12);
    const Vector6d step = damped.ldlt().solve(gradient);
    result.target_from_source = pose_exp(step) * result.target_from_source;
    const bool narrow = radius_mm <= end_mm * 1.0001;
    // Done when a step is small against the uncertainty that this very data leaves.
    const double step_squared = step.dot(hessian * step);
    result.converged = narrow && step_squared < kFlickerStep;
    if (narrow && step_squared < kInsignificantStep) break;
    radius_mm = std::max(end_mm, 0.7 * radius_mm);
  }
  result.iterations = std::min(result.iterations, options.max_iterations);

  find_matches(end_mm);
  const double limit = 4.0 * robust_scale();
  double squares = 0, normalised = 0;
  result.information.setZero();
  for (const Match& m : matches) {
    if (!m.found || std::abs(m.along_normal) > limit * m.sigma) continue;
    ++result.inliers;
    squares += m.along_normal * m.along_normal;
    normalised += m.along_normal * m.along_normal / (m.sigma * m.sigma);
    Eigen::Matrix<double, 3, 6> j;
    j << -cross_matrix(m.point), Eigen::Matrix3d::Identity();
    result.information += j.transpose() * m.weight * j;
  }
  if (result.inliers > 0) {
    const double n = static_cast<double>(result.inliers);
    result.rms_mm = std::sqrt(squares / n);
    result.normalised_rms = std::sqrt(normalised / n);
    result.overlap = n / static_cast<double>(samples.size());
    // Residuals larger than the stated noise are unmodelled error: the information shrinks with them.
    const double inflation = std::max(1.0, result.normalised_rms);
    result.information /= inflation * inflation;
  }
  return result;
}

}  // namespace gantry
