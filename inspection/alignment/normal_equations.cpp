#include "alignment/normal_equations.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

/// Mean square by which surfaces give way along themselves at a motion of 1 mm, below which nothing is held.
constexpr double kNothing = 1e-6;

}  // namespace

TukeyWeight tukey(double residual) {
  const double r = residual / kTukey, rest = 1 - r * r;
  if (!(rest > 0)) return {};
  return {rest * rest, rest * (1 - 5 * r * r)};
}

NormalEquations normal_equations(const std::vector<Pair>& pairs, const std::vector<double>& weight,
                                 const std::vector<unsigned char>& masked,
                                 const std::vector<double>& facet_angle, const FitFrame& frame) {
  NormalEquations e;
  std::vector<double> residuals;
  for (size_t i = 0; i < pairs.size(); ++i)
    if (pairs[i].found && !masked[i]) residuals.push_back(pairs[i].distance * std::sqrt(weight[i]));
  e.sigma = std::max(robust_sigma(std::move(residuals)), 1e-6);
  double squares = 0;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const Pair& p = pairs[i];
    if (!p.found || masked[i]) continue;
    const TukeyWeight tw = tukey(p.distance * std::sqrt(weight[i]) / e.sigma);
    if (tw.weight <= 0) continue;
    const double w = weight[i] * tw.weight;
    const Vector6d j = frame.row(p.point, p.normal);
    e.hessian += w * j * j.transpose();
    e.curvature += weight[i] * tw.slope * j * j.transpose();
    e.gradient -= w * p.distance * j;
    e.weight += w;
    squares += p.distance * p.distance;
    ++e.inliers;
    const double angle = facet_angle[static_cast<size_t>(p.triangle)];
    if (angle > 0) {
      // Evenly distributed within +- angle across the facets, in a direction that is not asked for.
      const Eigen::Vector3d across = p.normal.unitOrthogonal();
      for (const Eigen::Vector3d& t : {across, Eigen::Vector3d(p.normal.cross(across))}) {
        const Vector6d error = frame.row(p.point, t);
        e.pretended += w * angle * angle / 3 * error * error.transpose();
      }
    }
  }
  if (e.inliers > 0) e.rms_mm = std::sqrt(squares / static_cast<double>(e.inliers));
  return e;
}

HeldMotions split_motions(const NormalEquations& equations) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(equations.hessian / equations.weight);
  HeldMotions motions;
  std::vector<int> held, free;
  for (int k = 0; k < 6; ++k) {
    const Vector6d v = solver.eigenvectors().col(k);
    const double pretended = v.dot(equations.pretended * v) / equations.weight;
    (solver.eigenvalues()[k] > std::max(kNothing, 2 * pretended) ? held : free).push_back(k);
  }
  motions.held = solver.eigenvectors()(Eigen::all, held);
  motions.free = solver.eigenvectors()(Eigen::all, free);
  return motions;
}

}  // namespace gantry::internal
