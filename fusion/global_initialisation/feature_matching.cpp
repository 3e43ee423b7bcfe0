#include "global_initialisation/feature_matching.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <limits>
#include <tuple>

#include "global_initialisation/fpfh.h"

namespace gantry {
namespace {

constexpr size_t kCandidates = 3;     // nearest features of each point
constexpr Eigen::Index kBlock = 128;  // points compared at a time: bounds the memory

struct Candidate {
  uint32_t target, source;
  float score;  ///< Squared distance of the features, less that of the plainer one to the mean.
};

Eigen::MatrixXf two_scales(const PointCloud& cloud, double radius_mm) {
  Eigen::MatrixXf fine, coarse;
  tbb::parallel_invoke([&] { fine = compute_fpfh(cloud, radius_mm); },
                       [&] { coarse = compute_fpfh(cloud, 2 * radius_mm); });
  Eigen::MatrixXf both(fine.rows() + coarse.rows(), fine.cols());
  both << fine, coarse;
  return both;
}

struct Nearest {
  float squared_distance = std::numeric_limits<float>::infinity();
  uint32_t index = 0;
};
using NearestFew = std::array<Nearest, kCandidates>;

/// For each column of `queries` the nearest columns of `features`.
std::vector<NearestFew> nearest_features(const Eigen::MatrixXf& features, const Eigen::MatrixXf& queries) {
  const Eigen::VectorXf squares = features.colwise().squaredNorm().transpose();
  std::vector<NearestFew> nearest(static_cast<size_t>(queries.cols()));
  const Eigen::Index blocks = (queries.cols() + kBlock - 1) / kBlock;
  tbb::parallel_for(Eigen::Index{0}, blocks, [&](Eigen::Index block) {
    const Eigen::Index first = block * kBlock, count = std::min(kBlock, queries.cols() - first);
    Eigen::MatrixXf distances = -2 * features.transpose() * queries.middleCols(first, count);
    distances.colwise() += squares;
    for (Eigen::Index q = 0; q < count; ++q) {
      auto& few = nearest[static_cast<size_t>(first + q)];
      for (Eigen::Index i = 0; i < distances.rows(); ++i) {
        if (!(distances(i, q) < few.back().squared_distance)) continue;
        size_t at = kCandidates - 1;
        for (; at > 0 && distances(i, q) < few[at - 1].squared_distance; --at) few[at] = few[at - 1];
        few[at] = {distances(i, q), static_cast<uint32_t>(i)};
      }
      for (auto& n : few) n.squared_distance += queries.col(first + q).squaredNorm();
    }
  });
  return nearest;
}

}  // namespace

std::vector<Correspondence> match_features(const PointCloud& target, const PointCloud& source,
                                           double radius_mm, size_t max_count) {
  Eigen::MatrixXf target_features, source_features;
  tbb::parallel_invoke([&] { target_features = two_scales(target, radius_mm); },
                       [&] { source_features = two_scales(source, radius_mm); });
  const Eigen::VectorXf mean = (target_features.rowwise().sum() + source_features.rowwise().sum()) /
                               static_cast<float>(target_features.cols() + source_features.cols());
  const auto rarity = [&](const Eigen::MatrixXf& features) {
    return Eigen::VectorXf((features.colwise() - mean).colwise().squaredNorm().transpose());
  };
  const Eigen::VectorXf target_rarity = rarity(target_features), source_rarity = rarity(source_features);

  std::vector<Candidate> candidates;
  const auto add = [&](uint32_t t, uint32_t s, float squared_distance) {
    if (squared_distance < std::numeric_limits<float>::infinity())
      candidates.push_back({t, s, squared_distance - std::min(target_rarity[t], source_rarity[s])});
  };
  const auto of_source = nearest_features(target_features, source_features);
  for (uint32_t s = 0; s < of_source.size(); ++s)
    for (const auto& n : of_source[s]) add(n.index, s, n.squared_distance);
  const auto of_target = nearest_features(source_features, target_features);
  for (uint32_t t = 0; t < of_target.size(); ++t)
    for (const auto& n : of_target[t]) add(t, n.index, n.squared_distance);

  // The two directions round the score of one pair differently, so equal pairs join before they are ranked.
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(a.target, a.source, a.score) < std::tie(b.target, b.source, b.score);
  });
  const auto same_pair = [](const Candidate& a, const Candidate& b) {
    return a.target == b.target && a.source == b.source;
  };
  candidates.erase(std::unique(candidates.begin(), candidates.end(), same_pair), candidates.end());
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score < b.score; });
  if (candidates.size() > max_count) candidates.resize(max_count);
  std::vector<Correspondence> kept;
  for (const auto& c : candidates) kept.push_back({c.target, c.source});
  return kept;
}

}  // namespace gantry
