#include "joint/tag_prior.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>

#include "gantry/foundation/error.h"
#include "joint/normal_equations.h"

namespace gantry::internal {
namespace {

constexpr double kLeastVariance = 1e-12;

/// All scans that have a shared factor must mean the same parameters; returns how many.
Eigen::Index parameters_of(std::span<const RangeSurface> scans) {
  const RangeSurface* first = nullptr;
  for (const RangeSurface& s : scans) {
    const UncertainPose& tag = s.part_from_sensor;
    if (!tag.shared_factor.allFinite())
      throw InputError("scan " + s.name + ": the shared factor of its tag holds numbers that are not finite");
    if (tag.shared_factor.cols() == 0) continue;
    if (!first) first = &s;
    const UncertainPose& other = first->part_from_sensor;
    if (tag.calibration_id != other.calibration_id)
      throw InputError("scan " + s.name + ": its tag is of calibration '" + tag.calibration_id +
                       "', that of " + first->name + " of '" + other.calibration_id +
                       "': their errors are not shared; give --prior for both");
    if (tag.shared_factor.cols() != other.shared_factor.cols())
      throw InputError("scan " + s.name + ": the shared factor of its tag has " +
                       std::to_string(tag.shared_factor.cols()) + " parameters, that of " + first->name +
                       " " + std::to_string(other.shared_factor.cols()) + "; expected the same of both");
  }
  return first ? first->part_from_sensor.shared_factor.cols() : 0;
}

void check_independent(const RangeSurface& s) {
  const Matrix6d& c = s.part_from_sensor.independent;
  const Vector6d scale = c.diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * c * scale.asDiagonal();
  if (!c.allFinite() || (scaled - scaled.transpose()).cwiseAbs().maxCoeff() > 1e-6 ||
      Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(0) < -1e-6)
    throw InputError("scan " + s.name +
                     ": the covariance of its tag is none; expected a symmetric matrix of finite numbers "
                     "without negative eigenvalues");
}

}  // namespace

TagPrior::TagPrior(std::span<const RangeSurface> scans, const Eigen::Vector3d& centre) {
  const Eigen::Index parameters = parameters_of(scans), rows = 6 * static_cast<Eigen::Index>(scans.size());
  const Matrix6d about_centre = shifted_errors(Eigen::Vector3d::Zero(), centre);
  factor_ = Eigen::MatrixXd::Zero(rows, parameters);
  Eigen::MatrixXd weighted = factor_;  // D^-1 F
  information_ = Eigen::MatrixXd::Zero(rows, rows);
  for (size_t i = 0; i < scans.size(); ++i) {
    check_independent(scans[i]);
    const UncertainPose& tag = scans[i].part_from_sensor;
    const auto at = static_cast<Eigen::Index>(6 * i);
    Matrix6d own = about_centre * tag.independent * about_centre.transpose();
    own.diagonal().array() += kLeastVariance;
    if (tag.shared_factor.cols() > 0) {
      const SharedFactor factor = about_centre * tag.shared_factor;
      const double theta2 = factor.topRows<3>().squaredNorm(), t2 = factor.bottomRows<3>().squaredNorm();
      own.diagonal().head<3>().array() += theta2 * theta2;
      own.diagonal().tail<3>().array() += theta2 * t2;
      factor_.middleRows<6>(at) = factor;
    }
    own_covariance_.push_back(own);
    own_information_.push_back(own.llt().solve(Matrix6d::Identity()));
    weighted.middleRows<6>(at) = own_information_.back() * factor_.middleRows<6>(at);
    information_.block<6, 6>(at, at) = own_information_.back();
  }
  z_from_errors_ = weighted.transpose();
  if (parameters == 0) return;
  // Woodbury: (D + F F^T)^-1 = D^-1 - D^-1 F (1 + F^T D^-1 F)^-1 F^T D^-1.
  const Eigen::MatrixXd precision =
      Eigen::MatrixXd::Identity(parameters, parameters) + factor_.transpose() * weighted;
  z_from_errors_ = precision.llt().solve(z_from_errors_).eval();
  information_ -= weighted * z_from_errors_;
  information_ = 0.5 * (information_ + information_.transpose()).eval();
}

Matrix6d TagPrior::information_of(size_t scan) const {
  const auto factor = factor_.middleRows<6>(static_cast<Eigen::Index>(6 * scan));
  return (own_covariance_[scan] + factor * factor.transpose()).inverse();
}

TagPrior::ChiSquare TagPrior::chi_square(const Eigen::VectorXd& errors) const {
  ChiSquare result;
  const Eigen::VectorXd z = z_from_errors_ * errors;
  const Eigen::VectorXd left = errors - factor_ * z;
  result.shared = z.squaredNorm();
  for (size_t i = 0; i < own_information_.size(); ++i) {
    const Vector6d own = left.segment<6>(static_cast<Eigen::Index>(6 * i));
    result.own.push_back(own.dot(own_information_[i] * own));
  }
  return result;
}

double TagPrior::weakest(const Vector6d& unit) const {
  // The largest variance is at most the sum of the largest of D and of F F^T, and at least either of them.
  const Vector6d scale = unit.cwiseInverse();
  double own = 0;
  Eigen::MatrixXd factor = factor_;
  for (size_t i = 0; i < own_covariance_.size(); ++i) {
    const Matrix6d scaled = scale.asDiagonal() * own_covariance_[i] * scale.asDiagonal();
    own = std::max(own, Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(5));
    auto rows = factor.middleRows<6>(static_cast<Eigen::Index>(6 * i));
    rows = scale.asDiagonal() * rows;
  }
  double shared = 0;
  if (parameters() > 0)
    shared =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(factor.transpose() * factor).eigenvalues().maxCoeff();
  return 1 / (own + shared);
}

}  // namespace gantry::internal
