#include "gantry/fusion/global_initialisation.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string>

#include "gantry/foundation/error.h"
#include "gantry/geometry/point_index.h"
#include "global_initialisation/feature_matching.h"
#include "global_initialisation/gnc.h"
#include "global_initialisation/hypothesis_check.h"
#include "global_initialisation/k_core.h"
#include "global_initialisation/pair_voting.h"

namespace gantry {
namespace {

constexpr size_t kMinPoints = 50;            // fewer have no shape to speak of
constexpr size_t kMaxPoints = 10000;         // features are compared all against all
constexpr size_t kMaxSeeds = 60;             // cores tried
constexpr size_t kVotedPoses = 60;           // poses taken from pair voting
constexpr size_t kMinCoreInliers = 4;        // three fit any pose
constexpr double kSameRotationRad = 0.1745;  // 10 degrees: two proposals closer than this are one
constexpr double kSameDistanceSpacings = 4;

void require(bool valid, const char* message) {
  if (!valid) throw InputError(message);
}

void validate(const GlobalInitialisationOptions& o) {
  require(o.feature_radius_mm >= 0 && std::isfinite(o.feature_radius_mm),
          "feature_radius_mm: expected 0 or more");
  require(o.noise_bound_mm >= 0 && std::isfinite(o.noise_bound_mm), "noise_bound_mm: expected 0 or more");
  require(o.max_normal_angle_rad > 0 && o.max_normal_angle_rad < 1.5708,
          "max_normal_angle_rad: expected more than 0 and less than a right angle");
  require(o.max_correspondences >= 3 && o.max_correspondences <= 20000,
          "max_correspondences: expected 3 to 20000");
  require(o.max_proposals >= 1, "max_proposals: expected at least 1");
}

void validate(const PointCloud& cloud, const std::string& name) {
  if (cloud.normals.size() != cloud.size())
    throw InputError("global initialisation: the " + name + " has no normals");
  if (cloud.size() > kMaxPoints)
    throw InputError("global initialisation: the " + name + " has " + std::to_string(cloud.size()) +
                     " points; decimate it to " + std::to_string(kMaxPoints) + " at most");
  for (size_t i = 0; i < cloud.size(); ++i)
    if (!cloud.points[i].allFinite() || !(std::abs(cloud.normals[i].norm() - 1) < 0.01f))
      throw InputError("global initialisation: the " + name + "'s point " + std::to_string(i) +
                       " is not finite or its normal not of unit length");
}

double median_spacing(const PointCloud& cloud, const PointIndex& index) {
  std::vector<float> squares;
  std::vector<PointIndex::Neighbour> found;
  for (const auto& p : cloud.points) {
    index.nearest(p, 2, std::numeric_limits<float>::max(), found);
    squares.push_back(found.back().squared_distance);
  }
  const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
  std::nth_element(squares.begin(), middle, squares.end());
  return std::sqrt(*middle);
}

/// The two ends of a correspondence, packed for the all-against-all test.
struct OrientedPair {
  Eigen::Vector3f target, target_normal, source, source_normal;
};

struct Tolerances {
  float distance_mm, angle_rad;
  float min_length_mm;  ///< Points closer than this agree whatever the pose.
};

float angle_of(float cosine) {
  return std::acos(std::clamp(cosine, -1.f, 1.f));
}

/// Whether one rigid motion could carry both: equal point pair features on both surfaces.
bool compatible(const OrientedPair& a, const OrientedPair& b, const Tolerances& tolerances) {
  const Eigen::Vector3f dt = b.target - a.target, ds = b.source - a.source;
  const float lt = dt.norm(), ls = ds.norm();
  if (std::abs(lt - ls) > tolerances.distance_mm || std::min(lt, ls) < tolerances.min_length_mm) return false;
  const auto differ = [&](float cosine1, float cosine2) {
    return std::abs(angle_of(cosine1) - angle_of(cosine2)) > tolerances.angle_rad;
  };
  return !differ(a.target_normal.dot(b.target_normal), a.source_normal.dot(b.source_normal)) &&
         !differ(a.target_normal.dot(dt) / lt, a.source_normal.dot(ds) / ls) &&
         !differ(b.target_normal.dot(dt) / lt, b.source_normal.dot(ds) / ls);
}

Adjacency compatibility_graph(const std::vector<OrientedPair>& pairs, const Tolerances& tolerances) {
  const size_t n = pairs.size();
  Adjacency later(n);  // neighbours of higher number
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    for (size_t j = i + 1; j < n; ++j)
      if (compatible(pairs[i], pairs[j], tolerances)) later[i].push_back(static_cast<uint32_t>(j));
  });
  Adjacency graph(n);
  for (size_t i = 0; i < n; ++i)
    for (const uint32_t j : later[i]) graph[j].push_back(static_cast<uint32_t>(i));
  for (size_t i = 0; i < n; ++i) graph[i].insert(graph[i].end(), later[i].begin(), later[i].end());
  return graph;
}

/// The densest part of a vertex's neighbourhood, with the vertex: every clique it belongs to is in its
/// neighbourhood.
std::vector<uint32_t> core_around(const Adjacency& graph, uint32_t seed, std::vector<int>& local) {
  const auto& neighbours = graph[seed];
  for (size_t a = 0; a < neighbours.size(); ++a) local[neighbours[a]] = static_cast<int>(a);
  Adjacency within(neighbours.size());
  for (size_t a = 0; a < neighbours.size(); ++a)
    for (const uint32_t b : graph[neighbours[a]])
      if (local[b] >= 0) within[a].push_back(static_cast<uint32_t>(local[b]));
  for (const uint32_t b : neighbours) local[b] = -1;
  std::vector<uint32_t> members{seed};
  for (const uint32_t a : maximal_core(within)) members.push_back(neighbours[a]);
  return members;
}

/// Poses of one dense core after another: seeds by falling core number, without those that an earlier
/// pose explains.
std::vector<Pose> poses_of_cores(const std::vector<OrientedPair>& pairs, const Adjacency& graph,
                                 double noise_bound_mm, double lever_mm) {
  const auto cores = core_numbers(graph);
  std::vector<uint32_t> seeds(pairs.size());
  std::iota(seeds.begin(), seeds.end(), 0u);
  std::stable_sort(seeds.begin(), seeds.end(), [&](uint32_t a, uint32_t b) {
    return cores[a] != cores[b] ? cores[a] > cores[b] : graph[a].size() > graph[b].size();
  });
  std::vector<Pose> poses;
  std::vector<char> explained(pairs.size(), 0);
  std::vector<int> local(pairs.size(), -1);
  size_t tried = 0;
  for (const uint32_t seed : seeds) {
    if (tried == kMaxSeeds) break;
    if (explained[seed] || graph[seed].size() < kMinCoreInliers) continue;
    ++tried;
    const auto members = core_around(graph, seed, local);
    std::vector<OrientedMatch> matches;
    for (const uint32_t m : members)
      matches.push_back({pairs[m].target.cast<double>(), pairs[m].target_normal.cast<double>(),
                         pairs[m].source.cast<double>(), pairs[m].source_normal.cast<double>()});
    const GncResult result = align_by_gnc(matches, noise_bound_mm, lever_mm);
    if (result.inliers.size() < kMinCoreInliers) continue;
    for (const size_t i : result.inliers) explained[members[i]] = 1;
    poses.push_back(result.target_from_source);
  }
  return poses;
}

/// Aligns every pose and sorts them by score; those that nothing speaks for are left out.
std::vector<CheckedHypothesis> rank(const HypothesisCheck& check, const std::vector<Pose>& poses,
                                    const AlignmentSteps& steps) {
  std::vector<std::optional<CheckedHypothesis>> checked(poses.size());
  tbb::parallel_for(size_t{0}, poses.size(), [&](size_t i) { checked[i] = check.check(poses[i], steps); });
  std::vector<CheckedHypothesis> ranked;
  for (const auto& c : checked)
    if (c) ranked.push_back(*c);
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  return ranked;
}

/// The best of each group of similar poses, up to `limit`.
std::vector<CheckedHypothesis> distinct(const std::vector<CheckedHypothesis>& ranked,
                                        const Eigen::Vector3d& centre, double distance_mm, size_t limit) {
  std::vector<CheckedHypothesis> kept;
  for (const auto& c : ranked) {
    if (kept.size() == limit) break;
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const CheckedHypothesis& k) {
      return rotation_distance(k.target_from_source, c.target_from_source) < kSameRotationRad &&
             (k.target_from_source * centre - c.target_from_source * centre).norm() < distance_mm;
    });
    if (!known) kept.push_back(c);
  }
  return kept;
}

}  // namespace

std::vector<PoseProposal> propose_alignments(const PointCloud& target, const PointCloud& source,
                                             const GlobalInitialisationOptions& options) {
  validate(options);
  validate(target, "target");
  validate(source, "source");
  if (std::min(target.size(), source.size()) < kMinPoints) return {};
  const PointIndex target_index(target.points);
  const double spacing =
      std::max(median_spacing(target, target_index), median_spacing(source, PointIndex(source.points)));
  require(spacing > 0, "global initialisation: most points lie on top of each other");
  const double radius = options.feature_radius_mm > 0 ? options.feature_radius_mm : 4 * spacing;
  const double noise_bound = options.noise_bound_mm > 0 ? options.noise_bound_mm : 2 * spacing;

  const HypothesisCheck check(target, source, target_index, spacing, options.sensor_at_origin);
  std::vector<OrientedPair> pairs;
  for (const auto& c : match_features(target, source, radius, options.max_correspondences))
    pairs.push_back({target.points[c.target], target.normals[c.target], source.points[c.source],
                     source.normals[c.source]});
  const Tolerances tolerances{static_cast<float>(noise_bound),
                              static_cast<float>(options.max_normal_angle_rad),
                              static_cast<float>(2 * radius)};
  std::vector<Pose> poses = poses_of_cores(pairs, compatibility_graph(pairs, tolerances), noise_bound,
                                           noise_bound / options.max_normal_angle_rad);
  for (const auto& voted : vote_by_point_pairs(target, source, 2 * spacing, kVotedPoses))
    poses.push_back(voted.target_from_source);

  // Aligning finely may bring two guesses together, so some are kept in reserve.
  const Eigen::Vector3d centre = check.source_centre();
  const double distance = kSameDistanceSpacings * spacing;
  const auto coarse =
      distinct(rank(check, poses, kCoarseAlignment), centre, distance, 2 * options.max_proposals);
  std::vector<Pose> reserve;
  for (const auto& c : coarse) reserve.push_back(c.target_from_source);
  std::vector<PoseProposal> proposals;
  for (const auto& c :
       distinct(rank(check, reserve, kFineAlignment), centre, distance, options.max_proposals))
    proposals.push_back({c.target_from_source, c.inliers,
                         static_cast<double>(c.inliers) / static_cast<double>(source.size())});
  return proposals;
}

}  // namespace gantry
