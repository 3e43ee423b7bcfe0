#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// How the poses of all scans are found; what each does is said in the header of the same name.
enum class RegistrationMethod {
  kJoint,             ///< joint.h: one robust adjustment of all poses on the full-resolution surfaces.
  kRefinedPoseGraph,  ///< pose_graph_registration.h: the paper's; Generalized ICP and a pose graph.
  kPoseGraph,  ///< pose_graph_registration.h: the paper's baseline; point-to-plane ICP and a pose graph.
  kGlobalIcp,  ///< global_icp.h: the paper's baseline after Glira et al.; joint ICP on sampled points.
};

/// What two scans that share surface said about each other.
struct PairReport {
  size_t target = 0, source = 0;  ///< Indices of scans, target < source.
  /// Neighbours: in the tree of the greatest overlaps (the paper's methods), or one after the other in the
  /// order given (method "joint", to which it means nothing); otherwise a loop closure.
  bool odometry = false;
  double predicted_overlap = 0;  ///< From the tagged poses, 0..1; NaN: not predicted (method "joint").
  double overlap = 0;            ///< Fraction of the source's samples that found a partner at the end.
  size_t inliers = 0;            ///< Matches that took part.
  double rms_mm = 0;             ///< Of the inliers' distances along the normal.
  double disagreement_mm =
      0;  ///< Between the pair's own alignment and the final poses, at the scan's centre.
  bool kept = true;
  std::string reason;  ///< Why it was pruned.
};

/// A parameter as it was used: as given, or chosen from the data and why.
struct ParameterChoice {
  std::string name;  ///< With the unit: "voxel_size_mm".
  double value = 0;
  std::string reason;
};

/// What speaks for or against the place of one scan (method "joint").
struct ScanReport {
  double rms_mm = 0;                ///< Of its matches.
  size_t matches = 0;               ///< Pixels that found a partner, over all its pairs.
  double free_space_violation = 0;  ///< Fraction that lies in front of what another scan saw there.
  double opposite_contact = 0;      ///< Fraction that lies on a surface facing the other way.
  /// Of the tagged pose's own error (after what all scans share, see Registration), 6 degrees of freedom.
  double prior_chi_square = 0;
  double leave_one_out_mm = 0;  ///< How far the other scans would move without this one.
  bool connected = true;        ///< Shares surface with the first scan, directly or through others.
  std::string observability;    ///< Directions in which it could slide or turn, or how well it is fixed.
  /// Why it takes no part, in words that go on from its name: "is not held well enough: slides ...". Its pose
  /// is the last that was found before it was left out, and may be wrong. Empty: it takes part.
  std::string left_out;
};

/// The outcome of any method: a pose for each scan, in the order given; the first scan's is kept as tagged.
struct Registration {
  std::vector<UncertainPose> part_from_sensor;  ///< Covariances relative to the first scan.
  /// 6 n x 6 n: of all these errors at once, about the part's origin, relative to the first scan; scans that
  /// are left out count as if nothing held them. Empty: only what each pose says for itself is known.
  Eigen::MatrixXd joint_covariance;
  std::vector<PairReport> pairs;
  bool converged = false;
  std::string reason;  ///< Why the result is not to be believed; empty: it is.
  int iterations = 0;
  std::vector<ScanReport> scans;  ///< Empty for methods that do not judge themselves.
  /// Of the common error of all tagged poses (UncertainPose::shared_factor) that explains the result best:
  /// at most as many degrees of freedom as there are shared parameters. 0 without these.
  double shared_chi_square = 0;
  double wobble_mm = 0;                     ///< See joint/judgement.h; 0 for methods without this test.
  std::string way;                          ///< Which of a method's ways led to the result.
  std::vector<ParameterChoice> parameters;  ///< For the log.
};

}  // namespace gantry
