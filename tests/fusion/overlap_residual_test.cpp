#include "gantry/fusion/overlap_residual.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "fusion/scenes.h"
#include "gantry/geometry/point_index.h"

namespace gantry {
namespace {

struct Views {
  std::vector<RangeSurface> scans;
  std::vector<Pose> truth;
};

/// Two views of the bracket with much in common and one from the other side.
const Views& views() {
  static const Views made = [] {
    Views v;
    const RayScene scene(make_bracket());
    v.truth = {bracket_view(0.4, 0.9), bracket_view(1.0, 0.8), bracket_view(0.6, -0.9)};
    for (size_t i = 0; i < v.truth.size(); ++i)
      v.scans.push_back(make_range_surface(
          scan_of(scene, small_sensor(960), v.truth[i], i, "view" + std::to_string(i)), {}));
    return v;
  }();
  return made;
}

/// By the definition: nearest points of all pairs, found by a search tree.
OverlapResidual by_search_tree(const std::vector<RangeSurface>& scans, const std::vector<Pose>& poses) {
  std::vector<double> distances;
  for (size_t t = 0; t < scans.size(); ++t) {
    std::vector<unsigned char> rim;
    const PointCloud target = surface_cloud(scans[t], &rim);
    const PointIndex index(target.points);
    for (size_t s = 0; s < scans.size(); ++s) {
      if (s == t) continue;
      const Pose target_from_source = poses[t].inverse() * poses[s];
      const PointCloud source = surface_cloud(scans[s]);
      std::vector<PointIndex::Neighbour> nearest;
      for (size_t i = 0; i < source.size(); i += 3) {
        const Eigen::Vector3f p = (target_from_source * source.points[i].cast<double>()).cast<float>();
        const Eigen::Vector3f n = target_from_source.linear().cast<float>() * source.normals[i];
        index.nearest(p, 1, 2, nearest);
        if (nearest.empty() || rim[nearest[0].index]) continue;
        const Eigen::Vector3f& m = target.normals[nearest[0].index];
        if (m.dot(n) >= 0.7071f) distances.push_back(std::abs(m.dot(p - target.points[nearest[0].index])));
      }
    }
  }
  std::sort(distances.begin(), distances.end());
  distances.resize(distances.size() * 9 / 10);
  double squares = 0;
  for (const double d : distances) squares += d * d;
  return {std::sqrt(squares / static_cast<double>(distances.size())), distances.size()};
}

TEST(OverlapResidual, IsThatOfTheNearestPoints) {
  std::mt19937 random(5);
  for (const double error_mm : {0.0, 0.3, 1.5}) {
    std::vector<Pose> poses = views().truth;
    poses[1] = random_motion(random, bracket_middle(), error_mm, error_mm * 0.01) * poses[1];
    const OverlapResidual expected = by_search_tree(views().scans, poses);
    const OverlapResidual found = overlap_residual(views().scans, poses);
    EXPECT_NEAR(found.rms_mm, expected.rms_mm, 0.05 * expected.rms_mm) << "off by " << error_mm;
    EXPECT_GT(found.matches, 1000u);
  }
}

TEST(OverlapResidual, AtTheTruthItIsTheNoiseOfBothScans) {
  const OverlapResidual found = overlap_residual(views().scans, views().truth);
  // A normal distribution without its outer tenth has 0.789 of the standard deviation.
  EXPECT_NEAR(found.rms_mm, 0.789 * std::sqrt(2.0) * small_sensor().noise_mm, 0.15 * found.rms_mm);
}

TEST(OverlapResidual, EachScanHasItsOwn) {
  std::vector<Pose> poses = views().truth;
  poses[2].translation() += Eigen::Vector3d(0, 0, 1000);
  std::vector<double> of_scan;
  const OverlapResidual found = overlap_residual(views().scans, poses, &of_scan);
  ASSERT_EQ(of_scan.size(), 3u);
  EXPECT_EQ(of_scan[0], found.rms_mm);
  EXPECT_EQ(of_scan[1], found.rms_mm);
  EXPECT_EQ(of_scan[2], 0);
}

TEST(OverlapResidual, NothingInCommonIsNothingToAgreeOn) {
  EXPECT_EQ(overlap_residual({}, {}).matches, 0u);
  const OverlapResidual alone =
      overlap_residual(std::span(views().scans).first(1), std::span(views().truth).first(1));
  EXPECT_EQ(alone.matches, 0u);
  EXPECT_EQ(alone.rms_mm, 0);
}

}  // namespace
}  // namespace gantry
