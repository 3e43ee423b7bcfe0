#include "defects/residue.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr float kBesideMm = 1.0f;    ///< Points of other scans so close measured the same surface ...
constexpr float kSameSide = 0.7f;    ///< ... if the CAD surface faces the same way (cosine).
constexpr size_t kMostPairs = 3000;  ///< A scan's twist is fitted to, spread evenly over it.
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
  std::vector<std::vector<size_t>> of_scan;
  for (size_t i = 0; i < all_.point.size(); ++i) {
    if (all_.scan[i] == kManyScans || !std::isfinite(all_.deviation_mm[i])) continue;
    judged_.push_back(i);
    points_.push_back(all_.point[i]);
    centre_ += all_.point[i].cast<double>();
    if (all_.scan[i] >= of_scan.size()) of_scan.resize(all_.scan[i] + 1u);
    of_scan[all_.scan[i]].push_back(i);
  }
  motions_.resize(of_scan.size());
  if (judged_.empty()) return;
  centre_ /= static_cast<double>(judged_.size());
  index_ = std::make_unique<PointIndex>(points_);
  tbb::parallel_for(size_t{0}, of_scan.size(), [&](size_t scan) { fit_motion(scan, of_scan[scan]); });
}

ResidueFinder::~ResidueFinder() = default;

double ResidueFinder::beside(size_t i) const {
  thread_local std::vector<PointIndex::Neighbour> near;
  index_->within(all_.point[i], kBesideMm, near);
  std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
  double sum = 0, count = 0;
  for (const auto& each : near) {
    const size_t j = judged_[each.index];
    if (all_.scan[j] == all_.scan[i] || all_.normal[j].dot(all_.normal[i]) < kSameSide) continue;
    sum += all_.deviation_mm[j];
    ++count;
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

void ResidueFinder::fit_motion(size_t scan, const std::vector<size_t>& points) {
  std::vector<size_t> pairs;
  std::vector<double> departure;
  const size_t stride = points.size() / kMostPairs + 1;
  for (size_t k = 0; k < points.size(); k += stride)
    if (const double others = beside(points[k]); std::isfinite(others)) {
      pairs.push_back(points[k]);
      departure.push_back(all_.deviation_mm[points[k]] - others);
    }
  std::vector<Vector6d> row;
  double scale = 1;  // of rotations, so that the two halves of a twist are alike
  for (const size_t i : pairs) scale = std::max(scale, (all_.point[i].cast<double>() - centre_).norm());
  for (const size_t i : pairs) {
    const Eigen::Vector3d p = all_.point[i].cast<double>() - centre_, n = all_.normal[i].cast<double>();
    Vector6d j;
    j << p.cross(n) / scale, n;
    row.push_back(j);
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
  double probes = 0, seen = 0, good = 0, explained = 0;
  const size_t stride = members.size() / kMostPairs + 1;
  for (size_t k = 0; k < members.size(); k += stride) {
    const size_t i = members[k];
    if (all_.scan[i] != scan) continue;
    ++probes;
    explained += std::abs(all_.deviation_mm[i] - moved_by(scan, i)) <= tolerance_mm_;
    const double others = beside(i);
    if (!std::isfinite(others)) continue;
    ++seen;
    good += std::abs(others) <= tolerance_mm_;
  }
  if (seen < kSeenBeside * probes || good < kGood * seen || explained < kGood * probes) return std::nullopt;
  return scan;
}

}  // namespace gantry::internal
