#include <tbb/parallel_for.h>

#include <Eigen/SVD>
#include <cmath>
#include <numbers>

#include "alignment/datum_feature.h"
#include "alignment/words.h"
#include "gantry/foundation/error.h"
#include "gantry/inspection/datums.h"

namespace gantry {
namespace {

using namespace internal;

constexpr double kFixes = 0.05;      ///< A freedom counts as fixed when a demand holds it at least so well.
constexpr double kAtRest_mm = 1e-6;  ///< A step that moves the part by less ends the iteration.
constexpr int kMostRounds = 30;

/// The motion that meets demands in order of precedence.
struct Frame {
  Vector6d motion = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();
  Eigen::Matrix<double, 6, Eigen::Dynamic> open = Matrix6d::Identity();  ///< Freedoms that nothing fixes.
  std::vector<int> fixes;                                                ///< Per demand.
  std::vector<Eigen::VectorXd> left;                                     ///< Per demand: excess afterwards.
};

Frame build_frame(const std::vector<FeatureDemand>& demands) {
  Frame frame;
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> influence;  // of each excess on the motion
  for (const FeatureDemand& demand : demands) {
    influence.push_back(Eigen::Matrix<double, 6, Eigen::Dynamic>::Zero(6, demand.rows.rows()));
    frame.fixes.push_back(0);
    // Direction before position, both within what earlier datums left open.
    const Eigen::Index split[] = {0, demand.directions, demand.rows.rows()};
    for (const int group : {0, 1}) {
      const Eigen::Index first = split[group], count = split[group + 1] - first;
      if (count == 0 || frame.open.cols() == 0) continue;
      const Eigen::Matrix<double, Eigen::Dynamic, 6> rows = demand.rows.middleRows(first, count);
      const Eigen::JacobiSVD<Eigen::MatrixXd> svd(rows * frame.open,
                                                  Eigen::ComputeFullU | Eigen::ComputeFullV);
      Eigen::Index rank = 0;
      while (rank < svd.singularValues().size() && svd.singularValues()[rank] > kFixes) ++rank;
      if (rank == 0) continue;
      const Eigen::MatrixXd inverse = frame.open * svd.matrixV().leftCols(rank) *
                                      svd.singularValues().head(rank).cwiseInverse().asDiagonal() *
                                      svd.matrixU().leftCols(rank).transpose();
      frame.motion -= inverse * (demand.excess.segment(first, count) + rows * frame.motion);
      for (auto& each : influence) each -= inverse * (rows * each).eval();
      influence.back().middleCols(first, count) -= inverse;
      frame.open = (frame.open * svd.matrixV().rightCols(frame.open.cols() - rank)).eval();
      frame.fixes.back() += static_cast<int>(rank);
    }
  }
  for (size_t d = 0; d < demands.size(); ++d) {
    frame.covariance += influence[d] * demands[d].covariance * influence[d].transpose();
    frame.left.push_back(demands[d].excess + demands[d].rows * frame.motion);
  }
  return frame;
}

void require_complete(const Frame& frame, const DatumSet& set, const FitFrame& fit_frame) {
  std::string names;
  for (size_t d = 0; d < set.datums.size(); ++d) {
    names += (d > 0 ? ", " : "") + set.datums[d].name;
    if (frame.fixes[d] == 0)
      throw InputError("datums '" + set.name + "': datum '" + set.datums[d].name +
                       "' fixes nothing that those before it leave open");
  }
  if (frame.open.cols() == 0) return;
  AlignmentResult open;
  HeldMotions motions;
  motions.free = frame.open;
  open.free_motions = name_free_motions(motions, fit_frame);
  throw InputError("datums '" + set.name + "': " + names + " leave open: " + open.free_text());
}

/// As AlignmentResult has it: what becomes of the motion when each scan's pose is wrong a little.
template <typename Motion>
std::vector<Matrix6d> influence_of_scans(const CloudSources& sources, const std::vector<Pair>& pairs,
                                         const Motion& motion_of) {
  constexpr double kTurn = 1e-5, kShift_mm = 1e-3;
  const Vector6d as_it_is = motion_of(pairs);
  std::vector<Matrix6d> influence(sources.scans.size());
  tbb::parallel_for(size_t{0}, influence.size(), [&](size_t scan) {
    for (int k = 0; k < 6; ++k) {
      const double size = k < 3 ? kTurn : kShift_mm;
      const Vector6d error = size * Vector6d::Unit(k);
      std::vector<Pair> wrong = pairs;
      for (size_t i = 0; i < wrong.size(); ++i)
        for (const CloudSources::Share& share : sources.of(i)) {
          if (share.scan != scan) continue;
          const Eigen::Vector3d moved =
              share.fraction() * (error.head<3>().cross(pairs[i].point) + error.tail<3>());
          wrong[i].point += moved;
          wrong[i].distance += pairs[i].normal.dot(moved);
        }
      influence[scan].col(k) = (as_it_is - motion_of(wrong)) / size;
    }
  });
  return influence;
}

const char* kind_words(DatumKind kind) {
  switch (kind) {
    case DatumKind::kPlane:
      return "plane";
    case DatumKind::kCylinder:
      return "cylinder";
    case DatumKind::kPoint:
      return "point";
  }
  return "";
}

}  // namespace

AlignmentResult align_to_datums(const PointCloud& cloud, const SignedDistance& model, const DatumSet& set,
                                const AlignmentResult& start, const AlignmentOptions& options) {
  if (set.datums.empty()) throw InputError("datums '" + set.name + "': there are none");
  AlignmentResult result = start;
  std::vector<CadFeature> features;
  std::vector<Eigen::Vector3d> origins;
  for (const Datum& datum : set.datums) {
    features.push_back(cad_feature(datum, model.mesh(), set.name));
    origins.push_back(features.back().origin);
  }
  std::vector<uint32_t> in_reach;  // the points that may come to lie in a datum's region
  for (uint32_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = start.cad_from_cloud * cloud.points[i].cast<double>();
    for (const CadFeature& f : features) {
      if ((p - f.datum.position_mm).norm() > 2 * f.size_mm + options.initial_distance_mm) continue;
      in_reach.push_back(i);
      break;
    }
  }
  const PointCloud near = select(cloud, in_reach);
  const std::vector<double> weight = sample_weights(near);
  std::vector<Eigen::Vector3d> vertices;
  for (const auto& v : model.mesh().vertices) vertices.push_back(v.cast<double>());
  const FitFrame fit_frame = frame_of(vertices);

  const auto measure = [&](const std::vector<Pair>& from) {
    std::vector<FeatureDemand> measured;
    for (const CadFeature& f : features)
      measured.push_back(measure_feature(f, from, weight, fit_frame, set.name));
    return measured;
  };

  result.converged = false;
  result.iterations = 0;
  std::vector<Pair> pairs;
  std::vector<FeatureDemand> demands;
  Frame frame;
  while (result.iterations < kMostRounds && !result.converged) {
    find_pairs(near, model, result.cad_from_cloud, options.initial_distance_mm,
               std::cos(options.max_angle_rad), pairs);
    demands = measure(pairs);
    frame = build_frame(demands);
    require_complete(frame, set, fit_frame);
    result.cad_from_cloud = fit_frame.motion(frame.motion) * result.cad_from_cloud;
    ++result.iterations;
    result.converged = frame.motion.norm() < kAtRest_mm;
  }
  result.status = result.converged ? "" : "the datums did not come to rest";
  const Matrix6d to_twist = fit_frame.twist_from_local();
  result.covariance = result.held_covariance = to_twist * frame.covariance * to_twist.transpose();
  result.scan_influence.clear();
  if (near.sources)
    result.scan_influence = influence_of_scans(*near.sources, pairs, [&](const std::vector<Pair>& from) {
      return Vector6d(to_twist * build_frame(measure(from)).motion);
    });
  result.free_motions.clear();
  result.datums.clear();
  for (size_t d = 0; d < set.datums.size(); ++d) {
    DatumFit fit;
    const Eigen::Index directions = demands[d].directions;
    fit.name = set.datums[d].name;
    fit.fixes = frame.fixes[d];
    fit.words = kind_words(set.datums[d].kind) + std::string(", fixes ") + std::to_string(fit.fixes) +
                (fit.fixes == 1 ? " freedom" : " freedoms");
    fit.points = demands[d].points;
    fit.rms_mm = demands[d].rms_mm;
    fit.tilt_deg = frame.left[d].head(directions).norm() / fit_frame.lever_mm * 180 / std::numbers::pi;
    fit.offset_mm = frame.left[d].tail(frame.left[d].size() - directions).norm();
    result.datums.push_back(fit);
  }
  return result;
}

}  // namespace gantry
