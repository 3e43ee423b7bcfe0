#include "defects/residue.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr float kBesideMm = 1.0f;     ///< Points of other scans so close measured the same surface ...
constexpr float kSameSide = 0.7f;     ///< ... if the CAD surface faces the same way (cosine).
constexpr size_t kMostPairs = 20000;  ///< A scan's twist is fitted to, spread evenly over it.
constexpr size_t kLeastPairs = 30;
constexpr int kRounds = 10;
constexpr double kHeldShare = 1e-4;  ///< Directions held by less than this of the best one are not moved.
constexpr double kMostMembers = 0.5, kSeenBeside = 1.0 / 3, kGood = 0.8;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

ResidueFinder::ResidueFinder(const ScanDeviations& deviations, double tolerance_mm)
    : all_(deviations), tolerance_mm_(tolerance_mm) {
  const size_t n = all_.point.size();
  others_.assign(n, std::numeric_limits<double>::quiet_NaN());
  std::vector<size_t> judged;
  std::vector<Eigen::Vector3f> points;
  size_t scans = 0;
  for (size_t i = 0; i < n; ++i) {
    if (all_.scan[i] == kManyScans || !std::isfinite(all_.deviation_mm[i])) continue;
    judged.push_back(i);
    points.push_back(all_.point[i]);
    centre_ += all_.point[i].cast<double>();
    scans = std::max<size_t>(scans, all_.scan[i] + 1u);
  }
  motions_.resize(scans);
  if (judged.empty()) return;
  centre_ /= static_cast<double>(judged.size());
  const PointIndex index(points);
  tbb::parallel_for(size_t{0}, judged.size(), [&](size_t k) {
    thread_local std::vector<PointIndex::Neighbour> near;
    const size_t i = judged[k];
    index.within(points[k], kBesideMm, near);
    std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
    double sum = 0, count = 0;
    for (const auto& each : near) {
      const size_t j = judged[each.index];
      if (all_.scan[j] == all_.scan[i] || all_.normal[j].dot(all_.normal[i]) < kSameSide) continue;
      sum += all_.deviation_mm[j];
      ++count;
    }
    if (count > 0) others_[i] = sum / count;
  });
  for (size_t scan = 0; scan < scans; ++scan) fit_motion(scan);
}

void ResidueFinder::fit_motion(size_t scan) {
  std::vector<size_t> pairs;
  for (size_t i = 0; i < others_.size(); ++i)
    if (all_.scan[i] == scan && std::isfinite(others_[i])) pairs.push_back(i);
  const size_t stride = pairs.size() / kMostPairs + 1;
  std::vector<Vector6d> row;
  std::vector<double> departure;
  double scale = 1;  // of rotations, so that the two halves of a twist are alike
  for (size_t k = 0; k < pairs.size(); k += stride)
    scale = std::max(scale, (all_.point[pairs[k]].cast<double>() - centre_).norm());
  for (size_t k = 0; k < pairs.size(); k += stride) {
    const size_t i = pairs[k];
    const Eigen::Vector3d p = all_.point[i].cast<double>() - centre_, n = all_.normal[i].cast<double>();
    Vector6d j;
    j << p.cross(n) / scale, n;
    row.push_back(j);
    departure.push_back(all_.deviation_mm[i] - others_[i]);
  }
  Motion& motion = motions_[scan];
  motion.pairs = pairs.size();
  if (row.size() < kLeastPairs) return;
  Vector6d scaled = Vector6d::Zero();
  for (int round = 0; round < kRounds; ++round) {  // Tukey's biweight, its scale from the residuals' median
    std::vector<double> size;
    for (size_t k = 0; k < row.size(); ++k) size.push_back(std::abs(departure[k] - row[k].dot(scaled)));
    const double limit = 4.685 * std::max(1e-4, 1.4826 * median(size));
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    for (size_t k = 0; k < row.size(); ++k) {
      const double u = size[k] / limit;
      const double weight = round == 0 ? 1 : u < 1 ? (1 - u * u) * (1 - u * u) : 0;
      normal += weight * row[k] * row[k].transpose();
      right += weight * departure[k] * row[k];
    }
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(normal);
    const double most = solver.eigenvalues()[5];
    scaled.setZero();
    for (int k = 0; k < 6; ++k)
      if (solver.eigenvalues()[k] > kHeldShare * most)
        scaled += solver.eigenvectors().col(k) *
                  (solver.eigenvectors().col(k).dot(right) / solver.eigenvalues()[k]);
  }
  motion.twist << scaled.head<3>() / scale, scaled.tail<3>();
}

double ResidueFinder::moved_by(size_t scan, size_t i) const {
  const Eigen::Vector3d p = all_.point[i].cast<double>() - centre_, n = all_.normal[i].cast<double>();
  const Vector6d& twist = motions_[scan].twist;
  return p.cross(n).dot(twist.head<3>()) + n.dot(twist.tail<3>());
}

std::optional<size_t> ResidueFinder::scan_that_explains(std::span<const size_t> members) const {
  std::vector<size_t> count(motions_.size(), 0);
  for (const size_t i : members)
    if (all_.scan[i] != kManyScans) ++count[all_.scan[i]];
  if (count.empty()) return std::nullopt;
  const auto scan = static_cast<size_t>(std::max_element(count.begin(), count.end()) - count.begin());
  const auto own = static_cast<double>(count[scan]);
  if (own < kMostMembers * static_cast<double>(members.size())) return std::nullopt;
  double beside = 0, good = 0, explained = 0;
  for (const size_t i : members) {
    if (all_.scan[i] != scan) continue;
    explained += std::abs(all_.deviation_mm[i] - moved_by(scan, i)) <= tolerance_mm_;
    if (!std::isfinite(others_[i])) continue;
    ++beside;
    good += std::abs(others_[i]) <= tolerance_mm_;
  }
  if (beside < kSeenBeside * own || good < kGood * beside || explained < kGood * own) return std::nullopt;
  return scan;
}

}  // namespace gantry::internal
