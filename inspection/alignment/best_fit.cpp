#include "alignment/best_fit.h"

#include <algorithm>
#include <cmath>

#include "alignment/defect_mask.h"
#include "alignment/global_search.h"
#include "alignment/patch_covariance.h"
#include "alignment/scan_influence.h"
#include "alignment/tessellation.h"
#include "alignment/words.h"
#include "gantry/foundation/error.h"

namespace gantry {
namespace internal {

double patch_edge_mm(const TriangleMesh& mesh) {
  return std::sqrt(mesh.surface_area() / 100);
}

void state_uncertainty(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                       const std::vector<unsigned char>& masked, const NormalEquations& equations,
                       const FitFrame& frame, double patch_mm, AlignmentResult& result) {
  const HeldMotions motions = split_motions(equations);
  const Matrix6d to_twist = frame.twist_from_local();
  result.free_motions = name_free_motions(motions, frame);
  result.held_covariance.setZero();
  const Eigen::Index k = motions.held.cols();
  if (k > 0) {
    std::vector<Eigen::Vector3d> points, normals;
    std::vector<size_t> used;
    for (size_t i = 0; i < pairs.size(); ++i) {
      if (!pairs[i].found || masked[i]) continue;
      used.push_back(i);
      points.push_back(pairs[i].point);
      normals.push_back(pairs[i].normal);
    }
    const Eigen::MatrixXd curvature = motions.held.transpose() * equations.curvature * motions.held;
    const auto by_patches = [&](double edge_mm) {
      const std::vector<int> patch = patches_of(points, normals, edge_mm);
      const auto patches = static_cast<size_t>(*std::max_element(patch.begin(), patch.end()) + 1);
      std::vector<Eigen::MatrixXd> part(patches, Eigen::MatrixXd::Zero(k, k));
      std::vector<Eigen::VectorXd> gradient(patches, Eigen::VectorXd::Zero(k));
      for (size_t u = 0; u < used.size(); ++u) {
        const Pair& p = pairs[used[u]];
        const double weight = samples.weight[used[u]];
        const TukeyWeight tw = tukey(p.distance * std::sqrt(weight) / equations.sigma);
        const Eigen::VectorXd j = motions.held.transpose() * frame.row(p.point, p.normal);
        const auto at = static_cast<size_t>(patch[u]);
        part[at] += weight * tw.slope * j * j.transpose();
        gradient[at] -= weight * tw.weight * p.distance * j;
      }
      return patch_covariance(curvature, part, gradient);
    };
    // What patches share across their borders is missed in proportion to the borders' length, by half as
    // much with patches twice as wide: the variance with patches without borders lies as far beyond.
    const Eigen::MatrixXd narrow = by_patches(patch_mm), wide = by_patches(2 * patch_mm);
    const double beyond = 2 * (wide * curvature).trace() / (narrow * curvature).trace() - 1;
    result.held_covariance = std::max(1.0, beyond) * to_twist * motions.held * narrow *
                             motions.held.transpose() * to_twist.transpose();
  }
  result.scan_influence = scan_influence(samples, pairs, masked, equations, motions, frame);
  result.covariance = result.held_covariance + to_twist * motions.free * frame.lever_mm * frame.lever_mm *
                                                   motions.free.transpose() * to_twist.transpose();
}

}  // namespace internal

namespace {

using namespace internal;

constexpr double kAtRest_mm = 1e-5;     ///< A step that moves the part by less ends a fit.
constexpr size_t kFewestInliers = 30;   ///< Below, there is nothing to fit.
constexpr double kFarthestMask = 0.75;  ///< A mask of more than this share leaves no part to believe.

class BestFit {
 public:
  BestFit(const PointCloud& cloud, const SignedDistance& model, const AlignmentOptions& options)
      : model_(model),
        options_(options),
        samples_(choose_samples(cloud, options.samples)),
        facet_angle_(facet_angles(model.mesh(), adjacent_triangles(model.mesh()))),
        masked_(samples_.cloud.size(), 0),
        reach_mm_(options.initial_distance_mm) {}

  AlignmentResult run() {
    if (options_.from_any_start && !search()) return result_;
    find();
    state_rms_before();
    bool at_rest = fit();
    if (!enough()) return fail("fewer than 30 points lie near the model");
    at_rest = mask_and_fit() && at_rest;
    result_.converged = at_rest;
    if (!at_rest) result_.status = "the fit did not come to rest";
    const NormalEquations e = equations();
    result_.rms_after_mm = e.rms_mm;
    result_.inlier_fraction = static_cast<double>(e.inliers) / static_cast<double>(masked_.size());
    if (!enough()) return fail("what is no defect is too little to hold the part");
    state_uncertainty(samples_, pairs_, masked_, e, frame_, patch_edge_mm(model_.mesh()), result_);
    if (result_.masked_fraction > kFarthestMask)
      return fail("more than three quarters of the points lie out in regions");
    return result_;
  }

 private:
  AlignmentResult fail(const char* why) {
    result_.converged = false;
    result_.status = why;
    return result_;
  }

  bool search() {
    const auto pose = find_pose(samples_.cloud, model_);
    if (!pose) {
      result_.status = "no pose of the model fits the points";
      return false;
    }
    result_.cad_from_cloud = *pose;
    return true;
  }

  void find() {
    find_pairs(samples_.cloud, model_, result_.cad_from_cloud, reach_mm_, std::cos(options_.max_angle_rad),
               pairs_);
    std::vector<Eigen::Vector3d> points;
    for (size_t i = 0; i < pairs_.size(); ++i)
      if (pairs_[i].found && !masked_[i]) points.push_back(pairs_[i].point);
    frame_ = frame_of(points);
  }

  NormalEquations equations() const {
    return normal_equations(pairs_, samples_.weight, masked_, facet_angle_, frame_);
  }

  bool enough() const { return inliers_ >= kFewestInliers; }

  void state_rms_before() {
    double squares = 0, count = 0;
    for (const Pair& p : pairs_) {
      if (!p.found) continue;
      squares += p.distance * p.distance;
      ++count;
    }
    result_.rms_before_mm = count > 0 ? std::sqrt(squares / count) : 0;
  }

  /// Until at rest. The pairs are those of the final pose.
  bool fit() {
    for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
      const NormalEquations e = equations();
      inliers_ = e.inliers;
      ++result_.iterations;
      if (!enough()) return false;
      const HeldMotions motions = split_motions(e);
      Eigen::MatrixXd held = motions.held.transpose() * e.hessian * motions.held;
      const Vector6d step = motions.held * held.ldlt().solve(motions.held.transpose() * e.gradient);
      result_.cad_from_cloud = frame_.motion(step) * result_.cad_from_cloud;
      // Far points matter only while the fit is still coming in; later they are defects or clutter.
      reach_mm_ = std::clamp(20 * e.sigma, 1.0, options_.initial_distance_mm);
      find();
      if (step.norm() < kAtRest_mm) return true;
    }
    return false;
  }

  /// Fit and mask by turns. After half of the rounds a mask may grow but not shrink, so that the two cannot
  /// chase each other for ever.
  bool mask_and_fit() {
    bool fit_at_rest = true;
    for (int round = 0; round < options_.max_mask_rounds; ++round) {
      DefectMask mask = find_defect_mask(samples_, pairs_, masked_);
      if (2 * round >= options_.max_mask_rounds)
        for (size_t i = 0; i < masked_.size(); ++i) mask.masked[i] |= masked_[i];
      size_t changed = 0, count = 0;
      for (size_t i = 0; i < masked_.size(); ++i) {
        changed += mask.masked[i] != masked_[i];
        count += mask.masked[i];
      }
      masked_ = std::move(mask.masked);
      result_.masked_regions = mask.regions;
      result_.masked_fraction = static_cast<double>(count) / static_cast<double>(masked_.size());
      result_.mask_rounds = round + 1;
      if (changed == 0) return fit_at_rest;
      find();
      fit_at_rest = fit();
      if (!enough()) return false;
      if (2000 * changed <= masked_.size()) return fit_at_rest;  // at rest but for single samples
    }
    return false;
  }

  const SignedDistance& model_;
  const AlignmentOptions& options_;
  AlignmentSamples samples_;
  std::vector<double> facet_angle_;
  std::vector<unsigned char> masked_;
  double reach_mm_;
  std::vector<Pair> pairs_;
  FitFrame frame_;
  size_t inliers_ = 0;
  AlignmentResult result_;
};

void validate(const AlignmentOptions& o) {
  const auto require = [](bool ok, const std::string& what) {
    if (!ok) throw InputError("alignment: " + what);
  };
  require(o.initial_distance_mm > 0, "initial_distance_mm must be positive");
  require(o.samples >= 100, "samples must be at least 100");
  require(o.max_iterations >= 1, "max_iterations must be at least 1");
  require(o.max_mask_rounds >= 1, "max_mask_rounds must be at least 1");
  require(o.max_angle_rad > 0 && o.max_angle_rad < 3.2, "max_angle_rad must be from 0 to pi");
}

}  // namespace

AlignmentResult align_to_model(const PointCloud& cloud, const SignedDistance& model,
                               const AlignmentOptions& options) {
  validate(options);
  return BestFit(cloud, model, options).run();
}

std::string AlignmentResult::symmetry_text() const {
  if (equivalents.empty()) return "";
  std::string text = std::to_string(equivalents.size() + 1) + " equivalent poses: ";
  for (size_t i = 0; i < equivalents.size(); ++i) text += (i > 0 ? ", " : "") + equivalents[i].words;
  return text;
}

std::string AlignmentResult::free_text() const {
  std::string text;
  for (const FreeMotion& motion : free_motions) text += (text.empty() ? "" : "; ") + motion.words;
  return text;
}

}  // namespace gantry
