#include "alignment/defect_mask.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr double kSignificant = 5, kStillOut = 2;  // in sigmas of the averages
constexpr double kSameFace = 0.7;                  // cosine between normals
constexpr size_t kSmallest = 8;                    // samples; what is smaller is left to Tukey's weights
constexpr int kMargin = 2;                         // steps to neighbours

constexpr double kUnpaired = 1e9;

/// Mean of each sample's residual and its neighbours' on the same face, in sigmas of white noise.
std::vector<double> averages(const AlignmentSamples& samples, const std::vector<Pair>& pairs) {
  std::vector<double> average(pairs.size(), kUnpaired);
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!pairs[i].found) continue;
    double sum = samples.weight[i] * pairs[i].distance, weight = samples.weight[i];
    for (const uint32_t j : samples.neighbours[i]) {
      if (!pairs[j].found || pairs[j].normal.dot(pairs[i].normal) < kSameFace) continue;
      sum += samples.weight[j] * pairs[j].distance;
      weight += samples.weight[j];
    }
    average[i] = sum / std::sqrt(weight);
  }
  return average;
}

}  // namespace

DefectMask find_defect_mask(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                            const std::vector<unsigned char>& before) {
  const std::vector<double> average = averages(samples, pairs);
  std::vector<double> sound;
  for (size_t i = 0; i < pairs.size(); ++i)
    if (pairs[i].found && !before[i]) sound.push_back(average[i]);
  const double sigma = std::max(robust_sigma(std::move(sound)), 1e-5);
  const auto out_to = [&](size_t i, double limit) {  // +1 or -1, 0: within
    if (!pairs[i].found) return 2;
    return average[i] > limit * sigma ? 1 : average[i] < -limit * sigma ? -1 : 0;
  };

  DefectMask mask;
  mask.masked.assign(pairs.size(), 0);
  std::vector<unsigned char> seen(pairs.size(), 0);
  std::vector<uint32_t> region;
  for (uint32_t start = 0; start < pairs.size(); ++start) {
    const int side = out_to(start, kSignificant);
    if (side == 0 || seen[start]) continue;
    region.assign(1, start);
    seen[start] = 1;
    for (size_t k = 0; k < region.size(); ++k)
      for (const uint32_t j : samples.neighbours[region[k]])
        if (!seen[j] && out_to(j, kStillOut) == side) {
          seen[j] = 1;
          region.push_back(j);
        }
    if (region.size() < kSmallest) continue;
    ++mask.regions;
    for (const uint32_t i : region) mask.masked[i] = 1;
    for (int step = 0; step < kMargin; ++step) {
      std::vector<uint32_t> next;
      for (const uint32_t i : region)
        for (const uint32_t j : samples.neighbours[i])
          if (!mask.masked[j]) {
            mask.masked[j] = 1;
            next.push_back(j);
          }
      region = std::move(next);
    }
  }
  return mask;
}

}  // namespace gantry::internal
