#include "gantry/fusion/pose_graph.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>

#include "gantry/foundation/error.h"

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

/// A factor F with F^T F = information, which may be singular. Rotations and shifts differ in unit, so
/// it is scaled to a unit diagonal first: rounding then cannot invent information.
Matrix6d square_root(const Matrix6d& information) {
  const Vector6d scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt();
  const Matrix6d unit = scale.cwiseInverse().asDiagonal() * information * scale.cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 * (unit + unit.transpose()));
  const Vector6d roots = solver.eigenvalues().cwiseMax(0).cwiseSqrt();
  return roots.asDiagonal() * solver.eigenvectors().transpose() * scale.asDiagonal();
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
    for (int c = 0; c < 6; ++c) residual[r] += T(sqrt_information(r, c)) * error[c];
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

void check(size_t scans, const std::vector<PoseGraphEdge>& edges, size_t centres,
           const PoseGraphOptions& options) {
  if (centres != scans)
    throw InputError("pose graph: " + std::to_string(scans) + " poses but " + std::to_string(centres) +
                     " centres");
  for (const PoseGraphEdge& edge : edges)
    if (edge.target >= scans || edge.source >= scans || edge.target == edge.source)
      throw InputError("pose graph: an edge joins scans " + std::to_string(edge.target) + " and " +
                       std::to_string(edge.source) + " of " + std::to_string(scans));
  if (!(options.edge_prune_threshold_mm > 0))
    throw InputError("edge_prune_threshold_mm: must be a positive length, found " +
                     std::to_string(options.edge_prune_threshold_mm));
}

bool takes_part(const PoseGraphEdge& edge) {
  return edge.kept && edge.match.inliers > 0 && edge.match.information.diagonal().maxCoeff() > 0;
}

/// Poses carried from the first scan along the edges with the most matches; a scan that no edge reaches keeps
/// its tag. Starting from there the loss sees the edges' own errors, not those of the tags.
std::vector<Pose> chained(const std::vector<UncertainPose>& tagged, const std::vector<PoseGraphEdge>& edges) {
  std::vector<Pose> poses(tagged.size());
  for (size_t i = 0; i < tagged.size(); ++i) poses[i] = tagged[i].mean;
  std::vector<bool> reached(tagged.size(), false);
  reached[0] = true;
  for (;;) {
    const PoseGraphEdge* best = nullptr;
    for (const PoseGraphEdge& edge : edges)
      if (takes_part(edge) && reached[edge.target] != reached[edge.source] &&
          (!best || edge.match.inliers > best->match.inliers))
        best = &edge;
    if (!best) return poses;
    if (reached[best->target]) {
      poses[best->source] = poses[best->target] * best->match.target_from_source;
    } else {
      poses[best->target] = poses[best->source] * best->match.target_from_source.inverse();
    }
    reached[best->target] = reached[best->source] = true;
  }
}

/// Scale of the Cauchy loss in standard deviations: from wide to narrow, so that a wrong edge that was
/// believed at first can be outvoted.
constexpr double kLossScales[] = {1000, 100, 10};

/// The least-squares problem around fixed base poses; `x` are the corrections.
void build(ceres::Problem& problem, const std::vector<UncertainPose>& tagged,
           const std::vector<PoseGraphEdge>& edges, const std::vector<Pose>& base, double loss_scale,
           std::vector<State>& x) {
  for (size_t i = 0; i < tagged.size(); ++i) {
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
    if (!takes_part(edge)) continue;
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeError, 6, 6, 6>(new EdgeError{
                                 base[edge.target], base[edge.source], edge.match.target_from_source,
                                 square_root(edge.match.information)}),
                             new ceres::CauchyLoss(loss_scale), x[edge.target].data(), x[edge.source].data());
  }
}

bool solve(const std::vector<UncertainPose>& tagged, const std::vector<PoseGraphEdge>& edges,
           std::vector<Pose>& poses) {
  bool converged = false;
  for (const double loss_scale : kLossScales) {
    std::vector<State> x(tagged.size(), State{});
    ceres::Problem problem;
    build(problem, tagged, edges, poses, loss_scale, x);
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_QR;
    solver.max_num_iterations = 100;
    solver.function_tolerance = 1e-14;
    solver.parameter_tolerance = 1e-12;
    solver.num_threads = 1;  // small problem; one thread keeps the result the same everywhere
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    converged = summary.termination_type == ceres::CONVERGENCE;
    for (size_t i = 0; i < poses.size(); ++i) poses[i] = corrected(poses[i], x[i]);
  }
  return converged;
}

/// Covariance of each pose relative to the first, at the solution.
void add_covariances(const std::vector<UncertainPose>& tagged, const std::vector<PoseGraphEdge>& edges,
                     const std::vector<Pose>& poses, std::vector<UncertainPose>& out) {
  std::vector<State> x(tagged.size(), State{});
  ceres::Problem problem;
  build(problem, tagged, edges, poses, kLossScales[std::size(kLossScales) - 1], x);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  options.null_space_rank = -1;
  options.num_threads = 1;
  ceres::Covariance covariance(options);
  std::vector<std::pair<const double*, const double*>> blocks;
  for (size_t i = 1; i < poses.size(); ++i) blocks.emplace_back(x[i].data(), x[i].data());
  const bool computed = covariance.Compute(blocks, &problem);
  for (size_t i = 0; i < poses.size(); ++i) {
    out[i] = {};
    out[i].mean = poses[i];
    if (i == 0 || !computed) continue;
    Eigen::Matrix<double, 6, 6, Eigen::RowMajor> block;
    covariance.GetCovarianceBlock(x[i].data(), x[i].data(), block.data());
    out[i].independent = block;
  }
}

}  // namespace

double edge_disagreement_mm(const PairwiseResult& match, const Pose& actual_target_from_source,
                            const Eigen::Vector3d& centre, double resolution_mm) {
  // About the centre, so that rotations there leave it in place.
  const Eigen::Vector3d at = match.target_from_source * centre;
  Pose there = Pose::Identity();
  there.translation() = at;
  const Vector6d error =
      pose_log(there.inverse() * actual_target_from_source * match.target_from_source.inverse() * there);
  const Matrix6d motion = adjoint(there);
  const Matrix6d information = motion.transpose() * match.information * motion;
  // The edge's opinion of the error, given that it may be of the resolution's size: free directions vanish.
  // Rotations are given the lever of a scan seen from its sensor, which is generous.
  Matrix6d regular = information;
  const double w = 1 / (resolution_mm * resolution_mm);
  regular.diagonal().head<3>().array() += w * 1e-6 * at.squaredNorm() + 1e-12;
  regular.diagonal().tail<3>().array() += w;
  const Vector6d told = regular.ldlt().solve(information * error);
  return told.tail<3>().norm();
}

PoseGraphResult optimise_pose_graph(const std::vector<UncertainPose>& tagged,
                                    std::vector<PoseGraphEdge>& edges,
                                    const std::vector<Eigen::Vector3d>& centres,
                                    const PoseGraphOptions& options) {
  const size_t n = tagged.size();
  check(n, edges, centres.size(), options);
  PoseGraphResult result;
  result.part_from_sensor = tagged;
  if (n < 2) {
    result.converged = true;
    return result;
  }
  std::vector<Pose> poses = chained(tagged, edges);
  for (;;) {  // each round prunes an edge, so it ends
    result.converged = solve(tagged, edges, poses);
    PoseGraphEdge* worst = nullptr;
    for (PoseGraphEdge& edge : edges) {
      if (edge.match.inliers == 0) continue;
      edge.disagreement_mm =
          edge_disagreement_mm(edge.match, poses[edge.target].inverse() * poses[edge.source],
                               centres[edge.source], options.edge_prune_threshold_mm);
      if (takes_part(edge) && edge.disagreement_mm > options.edge_prune_threshold_mm &&
          (!worst || edge.disagreement_mm > worst->disagreement_mm))
        worst = &edge;
    }
    if (!worst) break;
    worst->kept = false;
    char text[96];
    std::snprintf(text, sizeof text, "disagrees with the other edges by %.3f mm (limit %.3f mm)",
                  worst->disagreement_mm, options.edge_prune_threshold_mm);
    worst->reason = text;
    ++result.pruned;
  }
  add_covariances(tagged, edges, poses, result.part_from_sensor);
  return result;
}

}  // namespace gantry
