#include "alignment/patch_covariance.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace gantry::internal {
namespace {

/// A patch that holds a direction (nearly) alone cannot be left out: it is taken as holding this share.
constexpr double kMostLeverage = 0.9;

}  // namespace

Eigen::MatrixXd patch_covariance(const Eigen::MatrixXd& curvature, const std::vector<Eigen::MatrixXd>& part,
                                 const std::vector<Eigen::VectorXd>& gradient) {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>;
  const Eigen::Index k = curvature.rows();
  const Solver solver(curvature);
  const Eigen::MatrixXd whiten = solver.operatorInverseSqrt();
  const auto patches = static_cast<double>(part.size());

  std::vector<Eigen::VectorXd> influence;
  Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(k, k);
  for (size_t p = 0; p < part.size(); ++p) {
    const Solver leverage(whiten * part[p] * whiten);
    const Eigen::VectorXd rest =
        (1 - leverage.eigenvalues().array().min(kMostLeverage)).rsqrt();  // (1 - h)^-1/2
    influence.push_back(leverage.eigenvectors() * rest.asDiagonal() * leverage.eigenvectors().transpose() *
                        (whiten * gradient[p]));
    scatter += influence.back() * influence.back().transpose();
  }
  const double alike = scatter.trace() / static_cast<double>(k);
  const Eigen::MatrixXd target = alike * Eigen::MatrixXd::Identity(k, k);
  const double distance = (scatter - target).squaredNorm();
  double error = 0;
  for (const auto& u : influence) error += (patches * u * u.transpose() - scatter).squaredNorm();
  error /= patches * patches;
  const double shrink = distance > 0 ? std::min(1.0, error / distance) : 1.0;
  const Eigen::MatrixXd shrunk = (1 - shrink) * scatter + shrink * target;
  // Few patches, or few that count, know the scatter badly.
  double squares = 0, fourths = 0;
  for (const auto& u : influence) {
    squares += u.squaredNorm();
    fourths += u.squaredNorm() * u.squaredNorm();
  }
  const auto size = static_cast<double>(k);
  const double count =
      fourths > 0 ? std::min(patches, squares * squares / fourths * (size + 2) / size) : patches;
  const double freedoms = shrink * size * (count - 1) + (1 - shrink) * (count - size);
  const double wider = 1 + 4 / std::max(4.0, freedoms);
  return wider * whiten * shrunk * whiten;
}

std::vector<int> patches_of(const std::vector<Eigen::Vector3d>& points,
                            const std::vector<Eigen::Vector3d>& normals, double edge_mm) {
  std::map<std::array<int, 3>, int> number;
  std::vector<int> patch;
  patch.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    Eigen::Index axis = 0;
    normals[i].cwiseAbs().maxCoeff(&axis);
    const int side = static_cast<int>(2 * axis) + (normals[i][axis] > 0);
    // Not by the coordinate along the normal: noise would decide it where a face lies between two cells.
    const auto cell = [&](Eigen::Index k) {
      return static_cast<int>(std::floor(points[i][k % 3] / edge_mm));
    };
    patch.push_back(
        number.try_emplace({cell(axis + 1), cell(axis + 2), side}, static_cast<int>(number.size()))
            .first->second);
  }
  return patch;
}

}  // namespace gantry::internal
