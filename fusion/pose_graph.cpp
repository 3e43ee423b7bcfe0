#include "gantry/fusion/pose_graph.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

namespace gantry {
namespace {

/// The state of a scan: a small correction x = (rotation vector, translation) to a fixed base pose,
/// pose = (R(x) base.R, R(x) base.t + x.t).
using State = std::array<double, 6>;

Pose corrected(const Pose& base, const State& x) {
  Pose pose = Pose::Identity();
  pose.linear() = rotation_exp({x[0], x[1], x[2]}) * base.linear();
  pose.translation() =
      rotation_exp({x[0], x[1], x[2]}) * base.translation() + Eigen::Vector3d(x[3], x[4], x[5]);
  return pose;
}

/// Upper factor U with U^T U = information.
Matrix6d square_root(const Matrix6d& information) {
  Matrix6d symmetric = 0.5 * (information + information.transpose());
  symmetric.diagonal().array() += 1e-12 * symmetric.diagonal().maxCoeff() + 1e-12;
  return symmetric.llt().matrixU();
}

template <typename T>
struct Rigid {
  T quaternion[4];  // w, x, y, z
  T translation[3];
};

template <typename T>
Rigid<T> corrected_rigid(const Pose& base, const T* x) {
  Rigid<T> out;
  T small[4];
  ceres::AngleAxisToQuaternion(x, small);
  const Eigen::Quaterniond q(base.linear());
  const T base_q[4] = {T(q.w()), T(q.x()), T(q.y()), T(q.z())};
  ceres::QuaternionProduct(small, base_q, out.quaternion);
  const T t[3] = {T(base.translation().x()), T(base.translation().y()), T(base.translation().z())};
  ceres::UnitQuaternionRotatePoint(small, t, out.translation);
  for (int k = 0; k < 3; ++k) out.translation[k] += x[3 + k];
  return out;
}

/// residual = sqrt_information * error, where exp(error) * measured = actual (first order).
template <typename T>
void weighted_error(const Rigid<T>& actual, const Pose& measured, const Matrix6d& sqrt_information,
                    T* residual) {
  const Eigen::Quaterniond mq(measured.linear());
  const T conjugate[4] = {T(mq.w()), T(-mq.x()), T(-mq.y()), T(-mq.z())};
  T dq[4];
  ceres::QuaternionProduct(actual.quaternion, conjugate, dq);
  T rotation[3];
  ceres::QuaternionToAngleAxis(dq, rotation);
  const T t[3] = {T(measured.translation().x()), T(measured.translation().y()),
                  T(measured.translation().z())};
  T moved[3];
  ceres::UnitQuaternionRotatePoint(dq, t, moved);
  T error[6];
  for (int k = 0; k < 3; ++k) {
    error[k] = rotation[k];
    error[3 + k] = actual.translation[k] - moved[k];
  }
  for (int r = 0; r < 6; ++r) {
    residual[r] = T(0);
    for (int c = r; c < 6; ++c) residual[r] += T(sqrt_information(r, c)) * error[c];
  }
}

struct EdgeError {
  Pose base_target, base_source, measured;
  Matrix6d sqrt_information;

  template <typename T>
  bool operator()(const T* target, const T* source, T* residual) const {
    const Rigid<T> a = corrected_rigid(base_target, target), b = corrected_rigid(base_source, source);
    const T inverse[4] = {a.quaternion[0], -a.quaternion[1], -a.quaternion[2], -a.quaternion[3]};
    Rigid<T> relative;  // target_from_source = a^-1 b
    ceres::QuaternionProduct(inverse, b.quaternion, relative.quaternion);
    const T d[3] = {b.translation[0] - a.translation[0], b.translation[1] - a.translation[1],
                    b.translation[2] - a.translation[2]};
    ceres::UnitQuaternionRotatePoint(inverse, d, relative.translation);
    weighted_error(relative, measured, sqrt_information, residual);
    return true;
  }
};

struct PriorError {
  Pose base, measured;
  Matrix6d sqrt_information;

  template <typename T>
  bool operator()(const T* x, T* residual) const {
    weighted_error(corrected_rigid(base, x), measured, sqrt_information, residual);
    return true;
  }
};

}  // namespace

PoseGraphResult optimise_pose_graph(const std::vector<UncertainPose>& tagged,
                                    std::vector<PoseGraphEdge>& edges,
                                    const std::vector<Eigen::Vector3d>& centres,
                                    const PoseGraphOptions& options) {
  const size_t n = tagged.size();
  PoseGraphResult result;
  result.part_from_sensor = tagged;
  if (n < 2) {
    result.converged = true;
    return result;
  }
  std::vector<Pose> base(n);
  for (size_t i = 0; i < n; ++i) base[i] = tagged[i].mean;

  for (int round = 0; round < 8; ++round) {
    std::vector<State> x(n, State{});
    ceres::Problem problem;
    for (size_t i = 0; i < n; ++i) {
      problem.AddParameterBlock(x[i].data(), 6);
      if (i == 0) continue;
      // What both share with the gauge cancels in relative poses; keeping it makes the prior weaker, not
      // wrong.
      const Matrix6d information =
          (tagged[i].covariance() + tagged[0].covariance() + 1e-12 * Matrix6d::Identity()).inverse();
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PriorError, 6, 6>(
                                   new PriorError{base[i], tagged[i].mean, square_root(information)}),
                               nullptr, x[i].data());
    }
    problem.SetParameterBlockConstant(x[0].data());
    for (const PoseGraphEdge& edge : edges) {
      if (!edge.kept) continue;
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeError, 6, 6, 6>(new EdgeError{
                                   base[edge.target], base[edge.source], edge.match.target_from_source,
                                   square_root(edge.match.information)}),
                               new ceres::CauchyLoss(10.0), x[edge.target].data(), x[edge.source].data());
    }
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_QR;
    solver.max_num_iterations = 100;
    solver.function_tolerance = 1e-14;
    solver.parameter_tolerance = 1e-12;
    solver.num_threads = 1;  // small problem; one thread keeps the result the same everywhere
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    result.converged = summary.termination_type == ceres::CONVERGENCE;
    for (size_t i = 0; i < n; ++i) result.part_from_sensor[i].mean = corrected(base[i], x[i]);

    PoseGraphEdge* worst = nullptr;
    for (PoseGraphEdge& edge : edges) {
      if (edge.match.inliers == 0) continue;
      const Pose actual =
          result.part_from_sensor[edge.target].mean.inverse() * result.part_from_sensor[edge.source].mean;
      const Eigen::Vector3d& centre = centres[edge.source];
      edge.disagreement_mm = (actual * centre - edge.match.target_from_source * centre).norm();
      if (edge.kept && edge.disagreement_mm > options.edge_prune_threshold_mm &&
          (!worst || edge.disagreement_mm > worst->disagreement_mm))
        worst = &edge;
    }
    if (worst && round < 7) {
      worst->kept = false;
      char text[96];
      std::snprintf(text, sizeof text, "disagrees with the other edges by %.3f mm (limit %.3f mm)",
                    worst->disagreement_mm, options.edge_prune_threshold_mm);
      worst->reason = text;
      ++result.pruned;
      continue;
    }

    ceres::Covariance::Options covariance_options;
    covariance_options.algorithm_type = ceres::DENSE_SVD;
    covariance_options.null_space_rank = -1;
    covariance_options.num_threads = 1;
    ceres::Covariance covariance(covariance_options);
    std::vector<std::pair<const double*, const double*>> blocks;
    for (size_t i = 1; i < n; ++i) blocks.emplace_back(x[i].data(), x[i].data());
    const bool computed = covariance.Compute(blocks, &problem);
    for (size_t i = 0; i < n; ++i) {
      result.part_from_sensor[i].shared.setZero();
      result.part_from_sensor[i].independent.setZero();
      if (i == 0 || !computed) continue;
      Eigen::Matrix<double, 6, 6, Eigen::RowMajor> block;
      covariance.GetCovarianceBlock(x[i].data(), x[i].data(), block.data());
      result.part_from_sensor[i].independent = block;
    }
    break;
  }
  return result;
}

}  // namespace gantry
