#include "global_initialisation/pair_voting.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

namespace gantry {
namespace {

constexpr size_t kPairPoints = 400;  // of each cloud take part
constexpr size_t kReferences = 120;  // source points that gather votes
constexpr size_t kPeaksPerReference = 3;
constexpr int kAngleBins = 12;           // of 15 degrees, over 0..pi
constexpr int kTurnBins = 30;            // of 12 degrees, around the reference's normal
constexpr float kMaxLengthBins = 200;    // longer pairs, as to a stray point far away, are left out
constexpr float kCoplanarRad = 0.2618f;  // 15 degrees
constexpr double kSameRotationRad = 0.26;
constexpr float kPi = std::numbers::pi_v<float>;

/// Points evenly spread over the cloud's order.
std::vector<uint32_t> spread(size_t size, size_t wanted) {
  std::vector<uint32_t> chosen(std::min(size, wanted));
  for (size_t i = 0; i < chosen.size(); ++i) chosen[i] = static_cast<uint32_t>(i * size / chosen.size());
  return chosen;
}

/// Carries an oriented point to the origin, its normal to x.
Eigen::Isometry3f canonical_frame(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) {
  Eigen::Isometry3f frame = Eigen::Isometry3f::Identity();
  const Eigen::Vector3f y = normal.unitOrthogonal();
  frame.linear() << normal.transpose(), y.transpose(), normal.cross(y).transpose();
  frame.translation() = -(frame.linear() * point);
  return frame;
}

struct PairFeature {
  uint32_t bin;
  float turn;  ///< Angle of the second point around the first one's normal.
};

class PairBins {
 public:
  PairBins(float step_mm, float longest_mm)
      : step_mm_(step_mm), lengths_(static_cast<int>(std::min(longest_mm / step_mm, kMaxLengthBins)) + 1) {}

  size_t count() const { return static_cast<size_t>(lengths_) * kAngleBins * kAngleBins * kAngleBins; }

  std::optional<PairFeature> describe(const Eigen::Isometry3f& frame, const Eigen::Vector3f& normal1,
                                      const Eigen::Vector3f& point2, const Eigen::Vector3f& normal2) const {
    const Eigen::Vector3f d = frame * point2;  // from the first point, normal along x
    const float length = d.norm();
    if (length < 2 * step_mm_ || length >= static_cast<float>(lengths_) * step_mm_) return std::nullopt;
    const int length_bin = std::min(lengths_ - 1, static_cast<int>(length / step_mm_));
    const Eigen::Vector3f turned2 = frame.linear() * normal2;
    const float angle1 = std::acos(std::clamp(d.x() / length, -1.f, 1.f));
    const float angle2 = std::acos(std::clamp(turned2.dot(d) / length, -1.f, 1.f));
    const float between = std::acos(std::clamp(normal1.dot(normal2), -1.f, 1.f));
    if (between < kCoplanarRad && std::abs(angle1 - kPi / 2) < kCoplanarRad) return std::nullopt;
    const auto quantise = [](float a) {
      return std::min(kAngleBins - 1, static_cast<int>(a / kPi * kAngleBins));
    };
    const int bin =
        ((length_bin * kAngleBins + quantise(angle1)) * kAngleBins + quantise(angle2)) * kAngleBins +
        quantise(between);
    return PairFeature{static_cast<uint32_t>(bin), std::atan2(d.z(), d.y())};
  }

 private:
  float step_mm_;
  int lengths_;
};

struct Entry {
  uint32_t reference;
  float turn;
};

}  // namespace

std::vector<VotedPose> vote_by_point_pairs(const PointCloud& target, const PointCloud& source,
                                           double distance_step_mm, size_t max_poses) {
  const auto target_chosen = spread(target.size(), kPairPoints);
  const auto source_chosen = spread(source.size(), kPairPoints);
  if (target_chosen.size() < 3 || source_chosen.size() < 3) return {};
  Eigen::AlignedBox3f box;
  for (const auto& p : target.points) box.extend(p);
  const PairBins bins(static_cast<float>(distance_step_mm), box.diagonal().norm());

  // The target's pairs, sorted by feature: those of bin b are entries[start[b] .. start[b + 1]).
  const size_t nt = target_chosen.size();
  std::vector<Eigen::Isometry3f> target_frames(nt);
  std::vector<std::optional<PairFeature>> features(nt * nt);
  tbb::parallel_for(size_t{0}, nt, [&](size_t i) {
    const auto& normal = target.normals[target_chosen[i]];
    target_frames[i] = canonical_frame(target.points[target_chosen[i]], normal);
    for (size_t j = 0; j < nt; ++j)
      features[i * nt + j] = bins.describe(target_frames[i], normal, target.points[target_chosen[j]],
                                           target.normals[target_chosen[j]]);
  });
  std::vector<uint32_t> start(bins.count() + 1, 0);
  for (const auto& f : features)
    if (f) ++start[f->bin + 1];
  for (size_t b = 1; b < start.size(); ++b) start[b] += start[b - 1];
  std::vector<Entry> entries(start.back());
  {
    std::vector<uint32_t> next(start.begin(), start.end() - 1);
    for (size_t i = 0; i < features.size(); ++i)
      if (features[i]) entries[next[features[i]->bin]++] = {static_cast<uint32_t>(i / nt), features[i]->turn};
  }

  // Every reference point of the source gathers votes for (target point, turn around the normal).
  const auto references = spread(source_chosen.size(), kReferences);
  std::vector<std::vector<VotedPose>> peaks(references.size());
  tbb::parallel_for(size_t{0}, references.size(), [&](size_t r) {
    const uint32_t own = source_chosen[references[r]];
    const Eigen::Isometry3f frame = canonical_frame(source.points[own], source.normals[own]);
    std::vector<float> votes(nt * kTurnBins, 0.f);
    for (const uint32_t other : source_chosen) {
      const auto f = bins.describe(frame, source.normals[own], source.points[other], source.normals[other]);
      if (!f) continue;
      // A common kind of pair says little: its vote is shared among those it may be.
      const float weight = 1 / std::sqrt(1.f + static_cast<float>(start[f->bin + 1] - start[f->bin]));
      for (uint32_t e = start[f->bin]; e < start[f->bin + 1]; ++e) {
        float turn = (entries[e].turn - f->turn) / (2 * kPi);
        turn -= std::floor(turn);
        const float at = turn * kTurnBins;
        const int bin = static_cast<int>(at) % kTurnBins;
        const float rest = at - std::floor(at);
        float* row = &votes[entries[e].reference * kTurnBins];
        row[bin] += weight * (1 - rest);
        row[(bin + 1) % kTurnBins] += weight * rest;
      }
    }
    for (size_t peak = 0; peak < kPeaksPerReference; ++peak) {
      const auto best = static_cast<size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
      if (!(votes[best] > 0)) break;
      const size_t at = best / kTurnBins;
      const float turn = 2 * kPi * static_cast<float>(best % kTurnBins) / kTurnBins;
      const Eigen::Isometry3f pose =
          target_frames[at].inverse() * Eigen::AngleAxisf(turn, Eigen::Vector3f::UnitX()) * frame;
      Pose refined = Pose::Identity();
      refined.linear() = Eigen::Quaterniond(pose.linear().cast<double>()).normalized().toRotationMatrix();
      refined.translation() = pose.translation().cast<double>();
      peaks[r].push_back({refined, votes[best]});
      std::fill_n(&votes[at * kTurnBins], kTurnBins, 0.f);
    }
  });

  // Similar poses join: their votes add up on the strongest.
  std::vector<VotedPose> all;
  for (const auto& p : peaks) all.insert(all.end(), p.begin(), p.end());
  const auto more_votes = [](const VotedPose& a, const VotedPose& b) { return a.votes > b.votes; };
  std::stable_sort(all.begin(), all.end(), more_votes);
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& p : source.points) centre += p.cast<double>() / static_cast<double>(source.size());
  std::vector<VotedPose> clusters;
  for (const auto& p : all) {
    const auto same = std::find_if(clusters.begin(), clusters.end(), [&](const VotedPose& c) {
      return (c.target_from_source * centre - p.target_from_source * centre).norm() < 2 * distance_step_mm &&
             rotation_distance(c.target_from_source, p.target_from_source) < kSameRotationRad;
    });
    if (same == clusters.end())
      clusters.push_back(p);
    else
      same->votes += p.votes;
  }
  std::stable_sort(clusters.begin(), clusters.end(), more_votes);
  if (clusters.size() > max_poses) clusters.resize(max_poses);
  return clusters;
}

}  // namespace gantry
