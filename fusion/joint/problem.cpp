#include "joint/problem.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

/// Pairs that agree in less than this fraction of what was tested share nothing worth matching.
constexpr double kLeastOverlap = 0.002;

}  // namespace

Pairs pairs_with_overlap(const JointProblem& problem, const Poses& poses, double tolerance_mm) {
  const size_t n = problem.size();
  const double samples = 3000 * problem.share_of_pair();
  std::vector<WeighedPair> candidates;
  for (size_t a = 0; a < n; ++a)
    for (size_t b = a + 1; b < n; ++b) candidates.push_back({a, b, 0});
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t k) {
    WeighedPair& c = candidates[k];
    for (const auto& [target, source] : {std::pair{c.a, c.b}, {c.b, c.a}}) {
      const RangeSurface& s = problem.scans[source];
      const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) / samples)));
      const Agreement agreement =
          compare(problem.scans[target], s, poses[target].inverse() * poses[source], tolerance_mm, stride);
      const double all = static_cast<double>(s.usable) / (stride * stride);
      if (static_cast<double>(agreement.matched) > kLeastOverlap * all) c.weight += agreement.matched;
    }
  });
  return strongest_pairs(std::move(candidates), n, problem.max_partners);
}

Eigen::VectorXd errors_of_tags(const JointProblem& problem, const Poses& poses) {
  Eigen::VectorXd errors(static_cast<Eigen::Index>(6 * problem.size()));
  for (size_t i = 0; i < problem.size(); ++i)
    errors.segment<6>(static_cast<Eigen::Index>(6 * i)) =
        log_about(problem.centre, poses[i] * problem.priors[i].part_from_grid.inverse());
  return errors;
}

double apply_step(const JointProblem& problem, const Eigen::VectorXd& step, Poses& poses) {
  double largest = 0;
  const Eigen::Matrix<double, 6, 1> first = step.head<6>();
  for (size_t i = 0; i < poses.size(); ++i) {
    const Vector6d twist = step.segment<6>(static_cast<Eigen::Index>(6 * i));
    poses[i] = exp_about(problem.centre, twist) * poses[i];
    const Vector6d relative = twist - first;
    largest = std::max(largest, relative.tail<3>().norm() + problem.radius_mm * relative.head<3>().norm());
  }
  return largest;
}

double difference_mm(const JointProblem& problem, const Poses& a, const Poses& b) {
  double largest = 0;
  const Pose common = a[0] * b[0].inverse();
  for (size_t i = 1; i < a.size(); ++i) {
    const Vector6d twist = log_about(problem.centre, common * b[i] * a[i].inverse());
    largest = std::max(largest, twist.tail<3>().norm() + problem.radius_mm * twist.head<3>().norm());
  }
  return largest;
}

}  // namespace gantry::internal
