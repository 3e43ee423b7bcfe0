#include "gantry/fusion/global_icp.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include "gantry/foundation/error.h"
#include "gantry/fusion/pairwise.h"
#include "paper_methods/plane_information.h"
#include "paper_methods/registration_support.h"

namespace gantry {
namespace {

constexpr double kShrink = 0.8;
constexpr double kEndInSpacings = 4;
/// While the radius is wide, this share of the samples shows the way.
constexpr size_t kWideStride = 4;
constexpr size_t kMinMatches = 50;
constexpr size_t kRoughnessNeighbours = 16;

void validate(const GlobalIcpOptions& o) {
  const auto check = [](bool good, const char* key, double value, const char* expected) {
    if (!good)
      throw InputError(std::string(key) + ": must be " + expected + ", found " + std::to_string(value));
  };
  const auto in = [](double value, double low, double high) { return value >= low && value <= high; };
  constexpr double kHuge = 1e12;
  check(o.samples >= kMinMatches, "samples", static_cast<double>(o.samples), "at least 50");
  check(in(o.max_distance_mm, 0, kHuge), "max_distance_mm", o.max_distance_mm, "a length, or 0 to derive it");
  check(in(o.max_deviation_mads, 1, kHuge), "max_deviation_mads", o.max_deviation_mads, "at least 1");
  check(in(o.max_roughness_sigmas, 1, kHuge), "max_roughness_sigmas", o.max_roughness_sigmas, "at least 1");
  check(in(o.max_angle_rad, 1e-3, std::numbers::pi), "max_angle_rad", o.max_angle_rad, "within (0, pi]");
  check(in(o.start_angle_rad, o.max_angle_rad, std::numbers::pi), "start_angle_rad", o.start_angle_rad,
        "within [max_angle_rad, pi]");
  check(in(o.min_overlap, 0, 1), "min_overlap", o.min_overlap, "in [0, 1]");
  check(o.max_iterations > 0, "max_iterations", o.max_iterations, "positive");
  check(in(o.tolerance_mm, 0, kHuge), "tolerance_mm", o.tolerance_mm, "a length, or 0 to derive it");
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// A pair's matches in one iteration.
struct Link {
  size_t target = 0, source = 0;
  double predicted_overlap = 0;
  bool odometry = false;
  std::vector<PlaneContact> contacts;  // part frame; normal_a is the plane's
  std::vector<double> residuals;       // along the plane's normal, from the moved point to the plane's
  size_t searched = 0;
  double rms_mm = 0;
};

/// All scans and pairs of one adjustment. Coordinates of the part frame are taken from the middle of the
/// scans and scaled by their size, so that the unknowns of rotation and shift weigh alike.
class Adjustment {
 public:
  Adjustment(std::span<const ScanSurface> surfaces, const GlobalIcpOptions& options)
      : surfaces_(surfaces), options_(options), targets_(surfaces.size()), samples_(surfaces.size()) {
    tbb::parallel_for(size_t{0}, surfaces.size(), [&](size_t i) {
      targets_[i] = std::make_unique<MatchTarget>(surfaces[i]);
      samples_[i] = smooth_samples(i);
    });
    for (const ScanSurface& surface : surfaces) {
      poses_.push_back(surface.part_from_sensor.mean);
      middle_ += surface.part_from_sensor.mean * centroid(surface) / static_cast<double>(surfaces.size());
    }
    for (const ScanSurface& surface : surfaces)
      for (size_t k = 0; k < surface.cloud.size(); k += 100)
        lever_mm_ = std::max(
            lever_mm_,
            (surface.part_from_sensor.mean * surface.cloud.points[k].cast<double>() - middle_).norm());
    for (const OverlappingPair& pair : pairs_at_tags(surfaces, options.min_overlap))
      for (const auto& [target, source] :
           {std::pair{pair.target, pair.source}, std::pair{pair.source, pair.target}}) {
        Link link;
        link.target = target;
        link.source = source;
        link.predicted_overlap = pair.overlap;
        link.odometry = pair.neighbours;
        links_.push_back(std::move(link));
      }
  }

  Registration run();

 private:
  std::vector<uint32_t> smooth_samples(size_t scan) const;
  void match(Link& link, double radius_mm, double min_cosine, size_t stride) const;
  double adjust();
  Eigen::MatrixXd information() const;
  void report(Registration& out) const;

  std::span<const ScanSurface> surfaces_;
  const GlobalIcpOptions& options_;
  std::vector<std::unique_ptr<MatchTarget>> targets_;
  std::vector<std::vector<uint32_t>> samples_;
  std::vector<Pose> poses_;
  std::vector<Link> links_;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();
  double lever_mm_ = 1;
};

/// Steps 1 and 3, by roughness: a sample on an edge or in clutter has no plane.
std::vector<uint32_t> Adjustment::smooth_samples(size_t scan) const {
  const ScanSurface& surface = surfaces_[scan];
  std::vector<uint32_t> samples = sample_points(surface, options_.sampling, options_.samples);
  std::vector<PointIndex::Neighbour> near;
  std::erase_if(samples, [&](uint32_t i) {
    targets_[scan]->index().nearest(surface.cloud.points[i], kRoughnessNeighbours, 1e9f, near);
    double sum = 0, squares = 0;
    for (const auto& n : near) {
      const double d = surface.cloud.normals[i].dot(surface.cloud.points[n.index] - surface.cloud.points[i]);
      sum += d;
      squares += d * d;
    }
    const double count = static_cast<double>(near.size());
    const double roughness = std::sqrt(std::max(0.0, squares / count - sum * sum / (count * count)));
    return roughness > options_.max_roughness_sigmas * surface.cloud.sigma_mm[i];
  });
  return samples;
}

/// Steps 2 to 4.
void Adjustment::match(Link& link, double radius_mm, double min_cosine, size_t stride) const {
  const ScanSurface &to = surfaces_[link.target], &from = surfaces_[link.source];
  const Pose &part_from_to = poses_[link.target], &part_from_from = poses_[link.source];
  const Pose to_from = part_from_to.inverse() * part_from_from;
  link.contacts.clear();
  link.residuals.clear();
  link.searched = 0;
  std::vector<PointIndex::Neighbour> nearest;
  for (size_t s = 0; s < samples_[link.source].size(); s += stride) {
    ++link.searched;
    const uint32_t i = samples_[link.source][s];
    const Eigen::Vector3d p = to_from * from.cloud.points[i].cast<double>();
    const MatchTarget& target = *targets_[link.target];
    if (radius_mm <= target.reach_mm() && !target.maybe_near(p.cast<float>())) continue;
    target.index().nearest(p.cast<float>(), 1, static_cast<float>(radius_mm), nearest);
    if (nearest.empty()) continue;
    const uint32_t j = nearest[0].index;
    if (to.rim[j]) continue;
    const Eigen::Vector3d n = to_from.linear() * from.cloud.normals[i].cast<double>();
    const Eigen::Vector3d m = to.cloud.normals[j].cast<double>();
    if (m.dot(n) < min_cosine) continue;
    link.residuals.push_back(m.dot(to.cloud.points[j].cast<double>() - p));
    link.contacts.push_back({part_from_to * p, part_from_to.linear() * m, part_from_to.linear() * n, 0});
  }
  const double centre = median(link.residuals);
  std::vector<double> deviation;
  for (const double r : link.residuals) deviation.push_back(std::abs(r - centre));
  const double sigma = std::max(1.4826 * median(std::move(deviation)), 1e-6);
  size_t kept = 0;
  double squares = 0;
  for (size_t k = 0; k < link.contacts.size(); ++k) {
    if (std::abs(link.residuals[k] - centre) > options_.max_deviation_mads * sigma) continue;
    link.contacts[kept] = link.contacts[k];
    link.contacts[kept].weight = 1 / (sigma * sigma);
    link.residuals[kept] = link.residuals[k];
    squares += link.residuals[k] * link.residuals[k];
    ++kept;
  }
  if (kept < kMinMatches) kept = 0;
  link.contacts.resize(kept);
  link.residuals.resize(kept);
  link.rms_mm = kept > 0 ? std::sqrt(squares / static_cast<double>(kept)) : 0;
}

/// Motions exp(e) of the part frame about its origin, in the adjustment's units: e = scale * x.
Matrix6d motion_from_unknown(const Eigen::Vector3d& middle, double lever_mm) {
  Matrix6d m = Matrix6d::Identity();
  m.topLeftCorner<3, 3>() /= lever_mm;
  m.bottomLeftCorner<3, 3>() = cross_matrix(middle) / lever_mm;
  return m;
}

/// Step 5: one Gauss-Newton step; returns by how much (mm) it moved any scan's surface, at most.
double Adjustment::adjust() {
  const Eigen::Index unknowns = 6 * (static_cast<Eigen::Index>(surfaces_.size()) - 1);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
  const Matrix6d motion = motion_from_unknown(middle_, lever_mm_);
  for (size_t i = 1; i < surfaces_.size(); ++i) {
    const UncertainPose& tag = surfaces_[i].part_from_sensor;
    const Matrix6d covariance =
        tag.covariance() + surfaces_[0].part_from_sensor.covariance() + 1e-12 * Matrix6d::Identity();
    const Matrix6d weight = motion.transpose() * covariance.inverse() * motion;
    const Vector6d left = motion.inverse() * pose_log(tag.mean * poses_[i].inverse());
    const Eigen::Index at = 6 * (static_cast<Eigen::Index>(i) - 1);
    normal.block<6, 6>(at, at) += weight;
    right.segment<6>(at) += weight * left;
  }
  for (const Link& link : links_) {
    Matrix6d block = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    for (size_t k = 0; k < link.contacts.size(); ++k) {
      const PlaneContact& c = link.contacts[k];
      Vector6d j;
      j << ((c.point - middle_) / lever_mm_).cross(c.normal_a), c.normal_a;
      block += c.weight * j * j.transpose();
      gradient += c.weight * link.residuals[k] * j;
    }
    const Eigen::Index s = 6 * (static_cast<Eigen::Index>(link.source) - 1),
                       t = 6 * (static_cast<Eigen::Index>(link.target) - 1);
    if (s >= 0) {
      normal.block<6, 6>(s, s) += block;
      right.segment<6>(s) += gradient;
    }
    if (t >= 0) {
      normal.block<6, 6>(t, t) += block;
      right.segment<6>(t) -= gradient;
    }
    if (s >= 0 && t >= 0) {
      normal.block<6, 6>(s, t) -= block;
      normal.block<6, 6>(t, s) -= block;
    }
  }
  normal.diagonal() *= 1 + 1e-9;
  const Eigen::VectorXd x = normal.ldlt().solve(right);
  double moved_mm = 0;
  for (size_t i = 1; i < surfaces_.size(); ++i) {
    const Vector6d step = x.segment<6>(6 * (static_cast<Eigen::Index>(i) - 1));
    poses_[i] = pose_exp(motion * step) * poses_[i];
    moved_mm = std::max(moved_mm, step.head<3>().norm() + step.tail<3>().norm());
  }
  return moved_mm;
}

/// Of the poses that were adjusted, in the adjustment's units, without what noisy normals pretend to know.
Eigen::MatrixXd Adjustment::information() const {
  const Eigen::Index unknowns = 6 * (static_cast<Eigen::Index>(surfaces_.size()) - 1);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
  const Matrix6d motion = motion_from_unknown(middle_, lever_mm_);
  for (size_t i = 1; i < surfaces_.size(); ++i) {
    const Matrix6d covariance = surfaces_[i].part_from_sensor.covariance() +
                                surfaces_[0].part_from_sensor.covariance() + 1e-12 * Matrix6d::Identity();
    const Eigen::Index at = 6 * (static_cast<Eigen::Index>(i) - 1);
    normal.block<6, 6>(at, at) += motion.transpose() * covariance.inverse() * motion;
  }
  for (const Link& link : links_) {
    const Matrix6d block = motion.transpose() * plane_information(link.contacts) * motion;
    const Eigen::Index s = 6 * (static_cast<Eigen::Index>(link.source) - 1),
                       t = 6 * (static_cast<Eigen::Index>(link.target) - 1);
    if (s >= 0) normal.block<6, 6>(s, s) += block;
    if (t >= 0) normal.block<6, 6>(t, t) += block;
    if (s >= 0 && t >= 0) {
      normal.block<6, 6>(s, t) -= block;
      normal.block<6, 6>(t, s) -= block;
    }
  }
  return normal;
}

Registration Adjustment::run() {
  Registration out;
  double end_mm = options_.max_distance_mm, radius_mm = options_.max_distance_mm, noise_mm = 0;
  std::vector<double> noises, spacings;
  for (const ScanSurface& surface : surfaces_) {
    noises.push_back(surface.noise_mm);
    spacings.push_back(surface.spacing_mm);
  }
  noise_mm = median(noises);
  if (options_.max_distance_mm == 0) {
    end_mm = kEndInSpacings * median(spacings);
    for (const Link& link : links_)
      radius_mm = std::max(radius_mm, start_radius_mm(surfaces_[link.target], surfaces_[link.source]));
    radius_mm = std::max(radius_mm, end_mm);
    out.parameters.push_back({"start_distance_mm", radius_mm, "three sigma of the tagged poses"});
    out.parameters.push_back({"max_distance_mm", end_mm, "four point spacings, where the radius ends"});
  }
  double tolerance_mm = options_.tolerance_mm;
  if (tolerance_mm == 0) {
    tolerance_mm = std::max(0.02 * noise_mm, 1e-6);
    out.parameters.push_back({"tolerance_mm", tolerance_mm, "a fiftieth of the median noise"});
  }

  const double first_mm = radius_mm;
  bool settled = links_.empty();
  for (out.iterations = 1; out.iterations <= options_.max_iterations && !links_.empty(); ++out.iterations) {
    const bool narrow = radius_mm <= 1.0001 * end_mm;
    // The angle narrows with the radius, in proportion to its logarithm.
    const double share = narrow ? 0 : std::log(radius_mm / end_mm) / std::log(first_mm / end_mm);
    const double angle = options_.max_angle_rad + share * (options_.start_angle_rad - options_.max_angle_rad);
    tbb::parallel_for(size_t{0}, links_.size(), [&](size_t k) {
      match(links_[k], radius_mm, std::cos(angle), narrow ? 1 : kWideStride);
    });
    settled = adjust() < tolerance_mm && narrow;
    if (settled) break;
    radius_mm = std::max(end_mm, kShrink * radius_mm);
  }
  out.iterations = std::min(out.iterations, options_.max_iterations);

  report(out);
  out.reason = unconnected_scans(surfaces_, out.pairs);
  if (out.reason.empty() && !settled)
    out.reason = "poses still moved after " + std::to_string(options_.max_iterations) + " iterations";
  out.converged = out.reason.empty();
  return out;
}

void Adjustment::report(Registration& out) const {
  const Matrix6d motion = motion_from_unknown(middle_, lever_mm_);
  Eigen::MatrixXd covariance;
  if (surfaces_.size() > 1) {
    const Eigen::MatrixXd normal = information();
    covariance = normal.ldlt().solve(Eigen::MatrixXd::Identity(normal.rows(), normal.cols()));
  }
  for (size_t i = 0; i < surfaces_.size(); ++i) {
    UncertainPose pose;
    pose.mean = poses_[i];
    if (i > 0) {
      const Eigen::Index at = 6 * (static_cast<Eigen::Index>(i) - 1);
      const Matrix6d block = motion * covariance.block<6, 6>(at, at) * motion.transpose();
      pose.independent = 0.5 * (block + block.transpose());
    }
    out.part_from_sensor.push_back(pose);
  }
  for (size_t k = 0; k + 1 < links_.size(); k += 2) {  // there and back
    const Link &there = links_[k], &back = links_[k + 1];
    PairReport pair;
    pair.target = there.target;
    pair.source = there.source;
    pair.odometry = there.odometry;
    pair.predicted_overlap = there.predicted_overlap;
    pair.inliers = there.contacts.size() + back.contacts.size();
    pair.overlap =
        there.searched ? static_cast<double>(there.contacts.size()) / static_cast<double>(there.searched) : 0;
    pair.rms_mm = std::max(there.rms_mm, back.rms_mm);
    pair.kept = pair.inliers > 0;
    if (!pair.kept) pair.reason = "too few matching points";
    out.pairs.push_back(std::move(pair));
  }
}

}  // namespace

Registration register_global_icp(std::span<const ScanSurface> surfaces, const GlobalIcpOptions& options) {
  validate(options);
  if (surfaces.empty()) throw InputError("registration: there is no scan to register");
  return Adjustment(surfaces, options).run();
}

}  // namespace gantry
