#include "gantry/inspection/alignment.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace gantry {
namespace {

constexpr double kTukey = 4.685;  ///< 95 % efficiency for Gaussian noise.

struct Pair {
  Eigen::Vector3d point, normal;  // both in the CAD frame
  double distance = 0;            // signed
  bool found = false;
};

double robust_sigma(const std::vector<Pair>& pairs) {
  std::vector<double> sizes;
  for (const Pair& p : pairs)
    if (p.found) sizes.push_back(std::abs(p.distance));
  if (sizes.empty()) return 0;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 1.4826 * *middle;
}

}  // namespace

AlignmentResult align_to_model(const PointCloud& cloud, const SignedDistance& model,
                               const AlignmentOptions& options) {
  AlignmentResult result;
  const size_t stride = std::max<size_t>(1, cloud.size() / std::max<size_t>(1, options.samples));
  std::vector<Pair> pairs((cloud.size() + stride - 1) / stride);
  const auto min_cosine = static_cast<float>(std::cos(options.max_angle_rad));

  const auto find_pairs = [&](double reach_mm) {
    const Pose pose = result.cad_from_cloud;
    tbb::parallel_for(size_t{0}, pairs.size(), [&](size_t s) {
      const size_t i = s * stride;
      Pair& pair = pairs[s];
      pair.found = false;
      pair.point = pose * cloud.points[i].cast<double>();
      const Eigen::Vector3f p = pair.point.cast<float>();
      const auto reach = static_cast<float>(reach_mm);
      std::optional<SignedDistance::Value> value;
      if (cloud.has_normals()) {
        value = model(p, (pose.linear() * cloud.normals[i].cast<double>()).cast<float>(), min_cosine, reach);
      } else {
        value = model(p, reach);
      }
      if (!value) return;
      // The plane of the closest face, not the edge's pseudonormal: a slide along it must cost nothing.
      pair.normal = model.mesh().normal(value->triangle).cast<double>();
      pair.distance = pair.normal.dot(pair.point - value->closest.cast<double>());
      pair.found = true;
    });
  };

  double reach_mm = options.initial_distance_mm;
  double sigma = 0;
  Matrix6d hessian = Matrix6d::Zero();
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    find_pairs(reach_mm);
    if (iteration == 0) {
      double squares = 0, count = 0;
      for (const Pair& p : pairs) {
        if (!p.found) continue;
        squares += p.distance * p.distance;
        ++count;
      }
      result.rms_before_mm = count > 0 ? std::sqrt(squares / count) : 0;
    }
    sigma = std::max(robust_sigma(pairs), 1e-6);
    const double cut = kTukey * sigma;
    hessian.setZero();
    Vector6d gradient = Vector6d::Zero();
    double squares = 0, inliers = 0, found = 0;
    for (const Pair& p : pairs) {
      if (!p.found) continue;
      ++found;
      const double r = p.distance / cut;
      if (std::abs(r) >= 1) continue;
      const double weight = (1 - r * r) * (1 - r * r);
      Vector6d j;
      j << p.point.cross(p.normal), p.normal;
      hessian += weight * j * j.transpose();
      gradient -= weight * p.distance * j;
      squares += p.distance * p.distance;
      ++inliers;
    }
    result.iterations = iteration + 1;
    if (inliers < 30) return result;
    result.rms_after_mm = std::sqrt(squares / inliers);
    result.inlier_fraction = inliers / static_cast<double>(pairs.size());
    Matrix6d damped = hessian;
    damped.diagonal() *= 1 + 1e-9;
    const Vector6d step = damped.ldlt().solve(gradient);
    result.cad_from_cloud = pose_exp(step) * result.cad_from_cloud;
    const double moved_mm = step.tail<3>().norm() + 100 * step.head<3>().norm();
    if (moved_mm < 1e-5) {
      result.converged = true;
      break;
    }
    // Far points matter only while the fit is still coming in; later they are defects or clutter.
    reach_mm = std::clamp(20 * sigma, 1.0, options.initial_distance_mm);
  }
  result.covariance = hessian.inverse() * sigma * sigma;
  return result;
}

}  // namespace gantry
