#include "information_bound.h"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <map>
#include <random>

namespace gantry::bench {
namespace {

constexpr double kElement_mm = 1;
/// Faces that differ by more than this in a component of their normals are elements of their own.
constexpr double kNormalStep = 0.4;

struct Element {
  Eigen::Vector3d place = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();  ///< sums over points
  double points = 0;
  std::map<size_t, double> information;  ///< 1 / mm^2 of each scan that sees it
};
using ElementKey = std::array<int, 6>;

std::map<ElementKey, Element> elements_of(const ScannedPart& part, const ScanSet& set,
                                          const SensorModel& sensor) {
  std::map<ElementKey, Element> elements;
  for (size_t i = 0; i < set.scans.size(); ++i) {
    const Scan& scan = set.scans[i].scan;
    const Eigen::Vector3f origin = set.truth[i].translation().cast<float>();
    for (size_t p = 0; p < scan.points.size(); ++p) {
      if (!scan.valid(p)) continue;
      const Eigen::Vector3d ray = set.truth[i].linear() * scan.points[p].cast<double>();
      const auto hit = part.scene().cast(origin, ray.cast<float>());
      if (!hit) continue;
      const Eigen::Vector3d place = set.truth[i].translation() + hit->distance * ray;
      const Eigen::Vector3d normal =
          part.scene().mesh().normal(static_cast<size_t>(hit->triangle)).cast<double>();
      ElementKey key;
      for (int axis = 0; axis < 3; ++axis) {
        key[axis] = static_cast<int>(std::floor(place[axis] / kElement_mm));
        key[3 + axis] = static_cast<int>(std::lround(normal[axis] / kNormalStep));
      }
      Element& element = elements[key];
      element.place += place;
      element.normal += normal;
      element.points += 1;
      const double distance_ratio = hit->distance * ray.norm() / 500;
      const double sigma_mm = sensor.noise_mm * distance_ratio * distance_ratio;  // along the normal
      element.information[i] += 1 / (sigma_mm * sigma_mm);
    }
  }
  return elements;
}

/// Of motions of all scans but the first about the part's centre.
Eigen::MatrixXd covariance_of(const std::map<ElementKey, Element>& elements, const ScanSet& set) {
  const auto dimension = static_cast<Eigen::Index>(6 * set.scans.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(dimension, dimension);
  for (const auto& [key, element] : elements) {
    const Eigen::Vector3d arm = element.place / element.points - set.centre,
                          normal = element.normal.normalized();
    Vector6d a;
    a << arm.cross(normal), normal;
    const Matrix6d aa = a * a.transpose();
    double all = 0;
    for (const auto& [scan, its] : element.information) all += its;
    // Its height taken out.
    for (const auto& [i, of_i] : element.information)
      for (const auto& [k, of_k] : element.information)
        information.block<6, 6>(static_cast<Eigen::Index>(6 * i), static_cast<Eigen::Index>(6 * k)) +=
            ((i == k ? of_i : 0) - of_i * of_k / all) * aa;
  }
  const double prior_rad = 15 * std::numbers::pi / 180, prior_mm = 15;
  for (Eigen::Index k = 6; k < dimension; ++k)
    information(k, k) += 1 / std::pow(k % 6 < 3 ? prior_rad : prior_mm, 2);
  const Eigen::MatrixXd held = information.bottomRightCorner(dimension - 6, dimension - 6);
  return held.ldlt().solve(Eigen::MatrixXd::Identity(dimension - 6, dimension - 6));
}

}  // namespace

std::vector<PoseError> information_bound(const ScannedPart& part, const ScanSet& set,
                                         const SensorModel& sensor, size_t draws) {
  const Eigen::MatrixXd covariance = covariance_of(elements_of(part, set, sensor), set);
  const Eigen::MatrixXd root = covariance.llt().matrixL();
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<PoseError> errors;
  for (size_t d = 0; d < draws; ++d) {
    const Eigen::VectorXd motion =
        root * Eigen::VectorXd::NullaryExpr(root.rows(), [&] { return normal(random); });
    std::vector<Pose> found = set.truth;
    for (size_t i = 1; i < found.size(); ++i) {
      const Vector6d its = motion.segment<6>(static_cast<Eigen::Index>(6 * (i - 1)));
      Pose about = Pose::Identity();
      about.linear() = rotation_exp(its.head<3>());
      about.translation() = set.centre - about.linear() * set.centre + its.tail<3>();
      found[i] = about * found[i];
    }
    errors.push_back(pose_error(set, initial_poses(set, 1, 3, 100 * d), found));
  }
  return errors;
}

}  // namespace gantry::bench
