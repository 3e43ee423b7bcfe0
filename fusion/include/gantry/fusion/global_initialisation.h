#pragma once

#include <cstddef>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"

namespace gantry {

/// Lengths that are 0 are chosen from the data.
struct GlobalInitialisationOptions {
  /// Radius (mm) of the neighbourhood that a feature describes; a second scale of twice this is added.
  /// 0: four times the point spacing.
  double feature_radius_mm = 0;
  /// How far (mm) two points of a true correspondence may lie apart. 0: twice the point spacing,
  /// because the two surfaces were sampled at different places.
  double noise_bound_mm = 0;
  double max_normal_angle_rad = 0.35;  ///< Normals of a true correspondence may differ by this (20 degrees).
  size_t max_correspondences = 2000;   ///< Vertices of the compatibility graph; cost grows with the square.
  size_t max_proposals = 5;
  /// Each cloud is in its sensor's frame: poses that put surface where the other sensor looked through
  /// are ranked down. What tells a flip of a thin or symmetric part from the truth; wrong for
  /// merged clouds.
  bool sensor_at_origin = true;
};

/// One guess of where the source lies.
struct PoseProposal {
  Pose target_from_source = Pose::Identity();
  size_t inliers = 0;  ///< Source points within half a spacing of the target's planes, normals agreeing.
  double inlier_fraction = 0;  ///< Of all source points: an estimate of the overlap.
};

/// Where may `source` lie on `target` when nothing is known of either's pose? Both are decimated
/// surfaces (1000 to 5000 points) of about the same spacing, mm, with unit normals towards the sensor.
/// Distinct guesses, best first, for the caller to refine and to verify (by visibility): on parts with
/// symmetric or repeated features the first is often a flip or a slip of the right one. Empty when
/// nothing speaks for any pose, as on a plane. The same input gives the same output on any number of
/// threads. Throws InputError when a point or normal is not finite, a cloud with points has no unit
/// normals, or an option is out of range.
///
/// After TEASER++ (Yang, Shi, Carlone, IEEE T-RO 2021) and KISS-Matcher (Lim et al., ICRA 2025):
///  1. features: Fast Point Feature Histograms (Rusu, Blodow, Beetz, ICRA 2009) at two scales;
///  2. correspondences: the nearest features, both ways;
///  3. pruning: two correspondences are compatible when the distance of their points and the three
///     angles with the normals, the point pair feature of Drost et al. (CVPR 2010), are equal on both
///     surfaces; true ones form a clique, sought as the maximal k-core (ROBIN: Shi, Yang, Carlone,
///     ICRA 2021) of the neighbourhood of one correspondence after another;
///  4. pose of each core: graduated non-convexity with truncated least squares (Yang, Antonante,
///     Tzoumas, Carlone, RA-L 2020);
///  5. further guesses by voting of point pairs (Drost et al.), for parts made of flat faces and bends,
///     whose local features all look alike;
///  6. proposals: a few steps of point-to-plane alignment each, ranked by how well the surfaces agree
///     where they meet, less the fractions of both that lie in free space.
std::vector<PoseProposal> propose_alignments(const PointCloud& target, const PointCloud& source,
                                             const GlobalInitialisationOptions& options = {});

}  // namespace gantry
