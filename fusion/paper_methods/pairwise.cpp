#include "gantry/fusion/pairwise.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "gantry/fusion/sampling.h"
#include "paper_methods/plane_information.h"

namespace gantry {
namespace {

/// The radius shrinks by this in each iteration: slowly enough that wide rotations settle on the way.
constexpr double kShrink = 0.8;
/// A step of which the square, in units of the pose's own covariance, is below this changes nothing that is
/// known.
constexpr double kInsignificantStep = 1e-2;
/// Matches may flicker between equally near points for ever; within one standard deviation that is no harm.
constexpr double kFlickerStep = 1.0;
constexpr size_t kMinMatches = 20;
/// Across the surface a match says nothing finer than the spacing; freedom across is what lets surfaces
/// slide into place, so it is generous: this many times the noise along the normal at the least.
constexpr double kAcrossInSigmas = 30;
/// With blurred surfaces (see the header) a match holds across with a fifth of its weight along the normal.
constexpr double kAcrossInBlurs = 2.2;

/// The grid that tells quickly what is far from a target.
constexpr double kCellInSpacings = 6;
constexpr float kMaxCells = 120;

struct Match {
  Eigen::Vector3d point;     // source point in the target frame
  Eigen::Vector3d residual;  // target point - point
  Eigen::Vector3d to, from;  // normals of target and source, target frame
  double along_normal = 0;   // distance along the common normal
  double sigma = 0;          // of that distance
  double sigma_to = 0, sigma_from = 0;
  bool found = false;
};

/// Covariance of a point on a locally plane surface: noise along the normal, spacing across.
Eigen::Matrix3d surface_covariance(const Eigen::Vector3d& normal, double along_mm, double across_mm) {
  const Eigen::Matrix3d nn = normal * normal.transpose();
  return along_mm * along_mm * nn + across_mm * across_mm * (Eigen::Matrix3d::Identity() - nn);
}

class Pairwise {
 public:
  Pairwise(const MatchTarget& target, const ScanSurface& source, std::span<const uint32_t> samples,
           const Pose& initial, const PairwiseOptions& options)
      : target_(target), to_(target.surface()), source_(source), samples_(samples), options_(options) {
    end_mm_ = options.min_distance_mm > 0 ? options.min_distance_mm
                                          : 4 * std::max(to_.spacing_mm, source.spacing_mm);
    min_cosine_ = std::cos(options.max_angle_rad);
    result_.target_from_source = initial;
    matches_.resize(samples.size());
  }

  PairwiseResult run() {
    iterate();
    if (options_.final_samples > 0 && result_.converged) {
      choose_final_samples();
      polishing_ = true;
      find_matches(end_mm_);
      polish();
    } else {
      find_matches(end_mm_);
    }
    judge();
    return result_;
  }

 private:
  void iterate();
  void polish();
  void judge();
  void choose_final_samples();
  void find_matches(double reach_mm);
  Eigen::Vector3d common_normal(const Match& match) const {
    return polishing_ || options_.method == PairwiseMethod::kPointToPlane
               ? match.to
               : (match.to + match.from).stableNormalized();
  }
  double median_normalised() const;
  double blur_mm() const;
  void accumulate(double scale, double blur, bool planes, Matrix6d& hessian, Vector6d& gradient,
                  size_t& found) const;

  const MatchTarget& target_;
  const ScanSurface& to_;
  const ScanSurface& source_;
  std::span<const uint32_t> samples_;
  const PairwiseOptions& options_;
  double end_mm_ = 0, min_cosine_ = 0;
  bool polishing_ = false;  // along the target's normals alone
  std::vector<uint32_t> final_samples_;
  double overlap_scale_ = 1;  // share of the source that the samples are taken from
  std::vector<Match> matches_;
  PairwiseResult result_;
};

void Pairwise::find_matches(double reach_mm) {
  const Pose pose = result_.target_from_source;
  tbb::parallel_for(tbb::blocked_range<size_t>(0, samples_.size(), 512), [&](const auto& range) {
    std::vector<PointIndex::Neighbour> nearest;
    for (size_t s = range.begin(); s < range.end(); ++s) {
      Match& match = matches_[s];
      match.found = false;
      const uint32_t i = samples_[s];
      match.point = pose * source_.cloud.points[i].cast<double>();
      if (reach_mm <= target_.reach_mm() && !target_.maybe_near(match.point.cast<float>())) continue;
      target_.index().nearest(match.point.cast<float>(), 1, static_cast<float>(reach_mm), nearest);
      if (nearest.empty()) continue;
      const uint32_t j = nearest[0].index;
      if (to_.rim[j]) continue;
      match.from = pose.linear() * source_.cloud.normals[i].cast<double>();
      match.to = to_.cloud.normals[j].cast<double>();
      if (match.to.dot(match.from) < min_cosine_) continue;
      match.residual = to_.cloud.points[j].cast<double>() - match.point;
      match.sigma_to = to_.cloud.sigma_mm[j];
      match.sigma_from = source_.cloud.sigma_mm[i];
      match.sigma = std::hypot(match.sigma_to, match.sigma_from);
      match.along_normal = common_normal(match).dot(match.residual);
      match.found = true;
    }
  });
}

template <typename Value>
double median_of(const std::vector<Match>& matches, Value&& value) {
  std::vector<double> values;
  values.reserve(matches.size());
  for (const Match& m : matches)
    if (m.found) values.push_back(value(m));
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double Pairwise::median_normalised() const {
  return std::max(
      1.0, 1.4826 * median_of(matches_, [](const Match& m) { return std::abs(m.along_normal) / m.sigma; }));
}

/// What the residuals show beyond the noise (one sigma, mm).
double Pairwise::blur_mm() const {
  const double spread = 1.4826 * median_of(matches_, [](const Match& m) { return std::abs(m.along_normal); });
  const double noise = median_of(matches_, [](const Match& m) { return m.sigma; });
  return std::sqrt(std::max(0.0, spread * spread - noise * noise));
}

void Pairwise::accumulate(double scale, double blur, bool planes, Matrix6d& hessian, Vector6d& gradient,
                          size_t& found) const {
  hessian.setZero();
  gradient.setZero();
  found = 0;
  for (const Match& m : matches_) {
    if (!m.found) continue;
    ++found;
    const double r = m.along_normal / (m.sigma * scale);
    const double loss_weight = 1.0 / ((1 + r * r) * (1 + r * r));  // Geman-McClure
    if (planes) {
      const Eigen::Vector3d normal = common_normal(m);
      Vector6d j;
      j << m.point.cross(normal), normal;
      const double weight = loss_weight / (m.sigma * m.sigma);
      hessian += weight * j * j.transpose();
      gradient += weight * m.along_normal * j;
      continue;
    }
    const double across_to =
        std::max({2 * to_.spacing_mm, kAcrossInSigmas * m.sigma_to, kAcrossInBlurs * blur});
    const double across_from =
        std::max({2 * source_.spacing_mm, kAcrossInSigmas * m.sigma_from, kAcrossInBlurs * blur});
    const Eigen::Matrix3d weight = (surface_covariance(m.to, std::hypot(m.sigma_to, blur), across_to) +
                                    surface_covariance(m.from, std::hypot(m.sigma_from, blur), across_from))
                                       .inverse();
    Eigen::Matrix<double, 3, 6> j;
    j << -cross_matrix(m.point), Eigen::Matrix3d::Identity();
    const Eigen::Matrix<double, 6, 3> jw = loss_weight * j.transpose() * weight;
    hessian += jw * j;
    gradient += jw * m.residual;
  }
}

void Pairwise::iterate() {
  double radius_mm = std::max(options_.max_distance_mm, end_mm_);
  double scale = 1e300, blur = 1e300;
  for (result_.iterations = 1; result_.iterations <= options_.max_iterations; ++result_.iterations) {
    find_matches(radius_mm);
    // Only ever narrower: a scale that follows every change of the matches would make them oscillate.
    scale = std::min(scale, 3.0 * median_normalised());
    blur = std::min(blur, blur_mm());
    Matrix6d hessian;
    Vector6d gradient;
    size_t found = 0;
    accumulate(scale, blur, options_.method == PairwiseMethod::kPointToPlane, hessian, gradient, found);
    if (found < kMinMatches) break;
    // The damping is far below what any real constraint contributes; it only keeps a slide finite.
    Matrix6d damped = hessian;
    damped.diagonal() += Vector6d(1e-9 * hessian.diagonal()) + Vector6d::Constant(1e-12);
    const Vector6d step = damped.ldlt().solve(gradient);
    result_.target_from_source = pose_exp(step) * result_.target_from_source;
    const bool narrow = radius_mm <= end_mm_ * 1.0001;
    // Done when a step is small against the uncertainty that this very data leaves.
    const double step_squared = step.dot(hessian * step);
    result_.converged = narrow && step_squared < kFlickerStep;
    if (narrow && step_squared < kInsignificantStep) break;
    radius_mm = std::max(end_mm_, kShrink * radius_mm);
  }
  result_.iterations = std::min(result_.iterations, options_.max_iterations);
}

/// Evenly from all points that lie near the target.
void Pairwise::choose_final_samples() {
  const Eigen::Isometry3f pose = result_.target_from_source.cast<float>();
  final_samples_.clear();
  for (uint32_t i = 0; i < source_.cloud.size(); ++i)
    if (!source_.rim[i] && target_.maybe_near(pose * source_.cloud.points[i])) final_samples_.push_back(i);
  const size_t all = final_samples_.size(), kept = std::min(all, options_.final_samples);
  for (size_t k = 0; k < kept; ++k) final_samples_[k] = final_samples_[k * all / kept];
  final_samples_.resize(kept);
  overlap_scale_ = static_cast<double>(all) / static_cast<double>(std::max<size_t>(1, source_.cloud.size()));
  samples_ = final_samples_;
  matches_.resize(samples_.size());
}

/// Gauss-Newton on fixed partners, along the target's normals alone: what is left to move is far less than
/// the spacing, and the hold that Generalized ICP has across the surface would keep it from moving.
void Pairwise::polish() {
  const double scale = 3.0 * median_normalised();
  for (int step_number = 0; step_number < 3; ++step_number) {
    Matrix6d hessian;
    Vector6d gradient;
    size_t found = 0;
    accumulate(scale, 0, true, hessian, gradient, found);
    if (found < kMinMatches) return;
    hessian.diagonal() += Vector6d(1e-9 * hessian.diagonal()) + Vector6d::Constant(1e-12);
    const Vector6d step = hessian.ldlt().solve(gradient);
    const Pose motion = pose_exp(step);
    result_.target_from_source = motion * result_.target_from_source;
    for (Match& m : matches_) {
      if (!m.found) continue;
      const Eigen::Vector3d moved = motion * m.point;
      m.residual += m.point - moved;
      m.point = moved;
      m.along_normal = common_normal(m).dot(m.residual);
    }
  }
}

void Pairwise::judge() {
  const double limit = 4.0 * median_normalised();
  double squares = 0, normalised = 0;
  std::vector<PlaneContact> contacts;
  for (const Match& m : matches_) {
    if (!m.found || std::abs(m.along_normal) > limit * m.sigma) continue;
    squares += m.along_normal * m.along_normal;
    normalised += m.along_normal * m.along_normal / (m.sigma * m.sigma);
    contacts.push_back({m.point, m.to, m.from, 1 / (m.sigma * m.sigma)});
  }
  result_.inliers = contacts.size();
  if (contacts.size() < kMinMatches) {
    result_.converged = false;
    return;
  }
  const double n = static_cast<double>(contacts.size());
  result_.rms_mm = std::sqrt(squares / n);
  result_.normalised_rms = std::sqrt(normalised / n);
  result_.overlap = overlap_scale_ * n / static_cast<double>(samples_.size());
  // Residuals larger than the stated noise are unmodelled error: the information shrinks with them.
  const double inflation = std::max(1.0, result_.normalised_rms);
  result_.information = plane_information(contacts) / (inflation * inflation);
}

}  // namespace

MatchTarget::MatchTarget(const ScanSurface& surface) : surface_(surface), index_(surface.cloud.points) {
  Eigen::AlignedBox3f box;
  for (const auto& p : surface.cloud.points) box.extend(p);
  if (box.isEmpty()) return;
  cell_mm_ = std::max(
      {static_cast<float>(kCellInSpacings * surface.spacing_mm), box.sizes().maxCoeff() / kMaxCells, 1e-6f});
  // One cell more on each side for the neighbours, and one for rounding.
  corner_ = box.min() - Eigen::Vector3f::Constant(2 * cell_mm_);
  cells_ = (box.sizes() / cell_mm_).cast<int>() + Eigen::Vector3i::Constant(5);
  std::vector<bool> surface_cells(cell_index(cells_ - Eigen::Vector3i::Ones()) + 1, false);
  occupied_ = surface_cells;
  for (const auto& p : surface.cloud.points) {
    const Eigen::Vector3i cell = ((p - corner_) / cell_mm_).cast<int>();
    const size_t at = cell_index(cell);
    if (surface_cells[at]) continue;
    surface_cells[at] = true;
    for (int dz = -1; dz <= 1; ++dz)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) occupied_[cell_index(cell + Eigen::Vector3i(dx, dy, dz))] = true;
  }
}

size_t MatchTarget::cell_index(const Eigen::Vector3i& cell) const {
  return (static_cast<size_t>(cell.z()) * cells_.y() + cell.y()) * cells_.x() + cell.x();
}

bool MatchTarget::maybe_near(const Eigen::Vector3f& point) const {
  const Eigen::Vector3f scaled = (point - corner_) / cell_mm_;
  // Also false for NaN; and a cast of what lies outside int's range would be undefined.
  if (!((scaled.array() >= 0).all() && (scaled.array() < cells_.cast<float>().array()).all())) return false;
  return occupied_[cell_index(scaled.cast<int>())];
}

void validate(const PairwiseOptions& options) {
  const auto check = [](bool good, const char* key, double value, const char* expected) {
    if (!good)
      throw InputError(std::string(key) + ": must be " + expected + ", found " + std::to_string(value));
  };
  check(options.max_distance_mm > 0 && std::isfinite(options.max_distance_mm), "max_distance_mm",
        options.max_distance_mm, "a positive length");
  check(options.min_distance_mm >= 0 && std::isfinite(options.min_distance_mm), "min_distance_mm",
        options.min_distance_mm, "a length, or 0 to derive it");
  check(options.max_angle_rad > 0 && options.max_angle_rad <= std::numbers::pi, "max_angle_rad",
        options.max_angle_rad, "within (0, pi]");
  check(options.max_iterations > 0, "max_iterations", options.max_iterations, "positive");
}

PairwiseResult register_pair(const MatchTarget& target, const ScanSurface& source,
                             std::span<const uint32_t> source_points, const Pose& initial_target_from_source,
                             const PairwiseOptions& options) {
  validate(options);
  return Pairwise(target, source, source_points, initial_target_from_source, options).run();
}

PairwiseResult register_pair(const MatchTarget& target, const ScanSurface& source,
                             const Pose& initial_target_from_source, const PairwiseOptions& options) {
  const std::vector<uint32_t> samples =
      sample_points(source, SamplingStrategy::kNormalSpace, options.samples);
  return register_pair(target, source, samples, initial_target_from_source, options);
}

}  // namespace gantry
