// The metrics behind one interface: axioms, oracles by brute force, bad input, threads.

#include "gantry/inspection/distances.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "foundation/expect_input_error.h"
#include "gantry/geometry/closest_on_triangle.h"
#include "geometry/solids.h"
#include "inspection/samples.h"

namespace gantry {
namespace {

const std::vector<Metric> kBetweenClouds = {
    Metric::kChamfer,     Metric::kChamferSquared, Metric::kHausdorff, Metric::kPercentileHausdorff,
    Metric::kEarthMovers, Metric::kPlane,          Metric::kQuadric,   Metric::kTriangulation,
    Metric::kM3c2};
const std::vector<Metric> kSymmetric = {Metric::kChamfer, Metric::kChamferSquared, Metric::kHausdorff,
                                        Metric::kPercentileHausdorff, Metric::kEarthMovers};

PointCloud random_cloud(size_t count, uint32_t seed, float size = 10) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> coordinate(0, size);
  PointCloud cloud;
  for (size_t i = 0; i < count; ++i) {
    const float x = coordinate(random), y = coordinate(random), z = coordinate(random);
    cloud.points.emplace_back(x, y, z);
  }
  return cloud;
}

/// A grid of 1 mm in the plane z.
PointCloud grid(int side, float z) {
  PointCloud cloud;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j) cloud.points.emplace_back(static_cast<float>(i), static_cast<float>(j), z);
  return cloud;
}

std::vector<float> brute_force(const PointCloud& from, const PointCloud& to) {
  std::vector<float> distances;
  for (const auto& p : from.points) {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& q : to.points) least = std::min(least, (p.cast<double>() - q.cast<double>()).norm());
    distances.push_back(static_cast<float>(least));
  }
  return distances;
}

double mean(const std::vector<float>& values, int power) {
  double sum = 0;
  for (const double v : values) sum += std::pow(v, power);
  return sum / static_cast<double>(values.size());
}

double value(const PointCloud& a, const PointCloud& b, Metric metric, const DistanceOptions& options = {}) {
  return compare(a, DistanceReference(b), metric, options).value;
}

TEST(Distances, NamesAndMetricsBelongTogether) {
  EXPECT_EQ(all_metrics().size(), 10u);
  for (const Metric m : all_metrics()) EXPECT_EQ(metric_named(to_string(m)), m);
  EXPECT_FALSE(metric_named("manhattan").has_value());
  EXPECT_EQ(unit_of(Metric::kChamferSquared), "mm2");
  EXPECT_EQ(unit_of(Metric::kM3c2), "mm");
}

TEST(Distances, OfACloudFromItselfIsNothing) {
  const PointCloud cloud = random_cloud(500, 1);
  for (const Metric m : kBetweenClouds) EXPECT_EQ(value(cloud, cloud, m), 0) << to_string(m);
}

TEST(Distances, SymmetricOnesAre) {
  const PointCloud a = random_cloud(300, 2), b = random_cloud(400, 3, 12);
  for (const Metric m : kSymmetric)
    EXPECT_NEAR(value(a, b, m), value(b, a, m), 1e-9 * value(a, b, m)) << to_string(m);
}

TEST(Distances, HausdorffAndEarthMoversKeepTheTriangleInequality) {
  for (uint32_t seed = 0; seed < 5; ++seed) {
    const PointCloud a = random_cloud(100, 10 + seed), b = random_cloud(100, 20 + seed, 13),
                     c = random_cloud(100, 30 + seed, 7);
    for (const Metric m : {Metric::kHausdorff, Metric::kEarthMovers})
      EXPECT_LE(value(a, c, m), value(a, b, m) + value(b, c, m) + 1e-6) << to_string(m);
  }
}

TEST(Distances, OfAPlaneMovedAlongItsNormalAreTheShift) {
  const PointCloud low = grid(20, 0), high = grid(20, 0.375f);
  for (const Metric m : kBetweenClouds) {
    const DistanceResult r = compare(high, DistanceReference(low), m);
    const double expected = m == Metric::kChamferSquared ? 2 * 0.375 * 0.375 : 0.375;
    EXPECT_NEAR(r.value, expected, 1e-7) << to_string(m);
    ASSERT_EQ(r.distance_mm.size(), high.size()) << to_string(m);
    for (const float d : r.distance_mm) EXPECT_NEAR(d, 0.375, 1e-6) << to_string(m);
  }
}

TEST(Distances, BetweenNearestPointsAgreeWithBruteForce) {
  const PointCloud a = random_cloud(700, 4), b = random_cloud(500, 5, 11);
  const std::vector<float> to_b = brute_force(a, b), to_a = brute_force(b, a);
  EXPECT_NEAR(value(a, b, Metric::kChamfer), (mean(to_b, 1) + mean(to_a, 1)) / 2, 1e-9);
  EXPECT_NEAR(value(a, b, Metric::kChamferSquared), mean(to_b, 2) + mean(to_a, 2), 1e-9);
  const double largest =
      std::max(*std::max_element(to_b.begin(), to_b.end()), *std::max_element(to_a.begin(), to_a.end()));
  EXPECT_EQ(value(a, b, Metric::kHausdorff), largest);
  EXPECT_EQ(compare(a, DistanceReference(b), Metric::kChamfer).distance_mm, to_b);  // in the order given
}

TEST(Distances, SummaryIsOfThePointsDistances) {
  PointCloud a, b;
  b.points = {{0, 0, 0}};
  for (int i = 1; i <= 5; ++i) a.points.emplace_back(static_cast<float>(i), 0, 0);
  const DistanceSummary s = compare(a, DistanceReference(b), Metric::kChamfer).summary;
  EXPECT_EQ(s.count, 5u);
  EXPECT_DOUBLE_EQ(s.mean, 3);
  EXPECT_DOUBLE_EQ(s.sigma, std::sqrt(2.0));
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(11.0));
  EXPECT_EQ(s.min, 1);
  EXPECT_EQ(s.max, 5);
  EXPECT_EQ(s.p50, 3);
  EXPECT_DOUBLE_EQ(s.p05, 1.2);
  EXPECT_DOUBLE_EQ(s.p95, 4.8);
}

TEST(Distances, PercentileOfHausdorffLeavesStrayPointsOut) {
  const PointCloud low = grid(20, 0);
  PointCloud high = grid(20, 0.5f);
  high.points[7].z() = 40;
  EXPECT_NEAR(value(high, low, Metric::kHausdorff), 40, 1e-5);
  EXPECT_NEAR(value(high, low, Metric::kPercentileHausdorff), 0.5, 1e-5);
  DistanceOptions all;
  all.percentile = 100;
  EXPECT_EQ(value(high, low, Metric::kPercentileHausdorff, all), value(high, low, Metric::kHausdorff));
}

TEST(Distances, LocalModelsAreNeverFartherThanTheNearestPoint) {
  const PointCloud a = random_cloud(400, 6), b = random_cloud(300, 7);
  const DistanceReference reference(b);
  const std::vector<float> to_b = brute_force(a, b);
  for (const Metric m : {Metric::kPlane, Metric::kQuadric, Metric::kTriangulation}) {
    const DistanceResult r = compare(a, reference, m);
    size_t nearer = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      EXPECT_LE(r.distance_mm[i], to_b[i]) << to_string(m);
      nearer += r.distance_mm[i] < to_b[i];
    }
    EXPECT_GT(nearer, a.size() / 4) << to_string(m);
  }
}

TEST(Distances, LocalModelsSeeASurfaceBetweenItsPoints) {
  PointCloud between;
  for (int i = 3; i < 16; ++i) between.points.emplace_back(i + 0.3f, i + 0.4f, 0.01f);
  const DistanceReference plane(grid(20, 0));
  for (const Metric m : {Metric::kPlane, Metric::kTriangulation})
    EXPECT_NEAR(compare(between, plane, m).value, 0.01, 1e-6) << to_string(m);
  EXPECT_NEAR(compare(between, plane, Metric::kChamfer).summary.mean, 0.5, 0.001);
}

TEST(Distances, CloudToMeshAgreesWithBruteForceAndHasASign) {
  const TriangleMesh star = star_mesh(3, 6);
  PointCloud cloud = random_cloud(400, 8, 14);
  for (auto& p : cloud.points) p -= Eigen::Vector3f::Constant(7);
  const DistanceReference reference(star, 1000);
  const DistanceResult r = compare(cloud, reference, Metric::kCloudToMesh);
  double sum = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = cloud.points[i].cast<double>();
    double least = std::numeric_limits<double>::infinity(), turns = 0;
    for (const auto& t : star.triangles) {
      const Eigen::Vector3d a = star.vertices[t[0]].cast<double>(), b = star.vertices[t[1]].cast<double>(),
                            c = star.vertices[t[2]].cast<double>();
      TriangleFeature feature;
      least = std::min(least, (closest_on_triangle(p, a, b, c, feature) - p).norm());
      // Solid angle (van Oosterom and Strackee, 1983); in all 4 pi inside, 0 outside.
      const Eigen::Vector3d u = a - p, v = b - p, w = c - p;
      turns += 2 * std::atan2(u.dot(v.cross(w)), u.norm() * v.norm() * w.norm() + u.dot(v) * w.norm() +
                                                     v.dot(w) * u.norm() + w.dot(u) * v.norm());
    }
    const double expected = turns > 6 ? -least : least;
    EXPECT_NEAR(r.distance_mm[i], expected, 1e-5) << "point " << i;
    sum += least;
  }
  EXPECT_NEAR(r.value, sum / static_cast<double>(cloud.size()), 1e-5);
  EXPECT_LT(r.summary.min, -0.5);
}

TEST(Distances, AMeshServesMetricsBetweenCloudsBySamples) {
  const TriangleMesh box = box_mesh({0, 0, 0}, {10, 10, 10});
  const DistanceReference reference(box, 20000);
  EXPECT_EQ(reference.cloud().size(), 20000u);
  const PointCloud on_it = mesh_points(box, 20000, 0);
  EXPECT_LT(compare(on_it, reference, Metric::kChamfer).value,
            0.12);  // about half the spacing of the samples
  EXPECT_LT(compare(on_it, reference, Metric::kPlane).value, 0.02);
  EXPECT_LT(compare(on_it, reference, Metric::kCloudToMesh).value, 1e-5);
}

TEST(Distances, EarthMoversSaysWhatItApproximated) {
  const PointCloud a = random_cloud(900, 9), b = random_cloud(901, 10);
  DistanceOptions coarse;
  coarse.exact_assignment_points = 300;
  const DistanceResult exact = compare(a, DistanceReference(b), Metric::kEarthMovers);
  const DistanceResult rough = compare(a, DistanceReference(b), Metric::kEarthMovers, coarse);
  EXPECT_EQ(exact.error_bound_mm, 0);
  EXPECT_NE(exact.note.find("900 and 901 points"), std::string::npos) << exact.note;
  EXPECT_NE(rough.note.find("approximate"), std::string::npos) << rough.note;
  EXPECT_GT(rough.error_bound_mm, 0);
  EXPECT_LE(std::abs(rough.value - exact.value), rough.error_bound_mm);
}

TEST(Distances, TogetherAreTheSameAsOneByOne) {
  const PointCloud a = random_cloud(300, 11);
  const DistanceReference b(random_cloud(350, 12));
  const auto together = compare(a, b, kBetweenClouds);
  for (size_t i = 0; i < kBetweenClouds.size(); ++i)
    EXPECT_EQ(together[i].value, compare(a, b, kBetweenClouds[i]).value) << to_string(kBetweenClouds[i]);
}

TEST(Distances, DoNotDependOnTheNumberOfThreads) {
  const TriangleMesh box = box_mesh({0, 0, 0}, {10, 10, 10});
  const PointCloud cloud = mesh_points(box, 3000, 0.1f);
  const auto measured = [&](size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    DistanceOptions options;
    options.exact_assignment_points = 300;
    return compare(cloud, DistanceReference(box, 3000), all_metrics(), options);
  };
  const auto one = measured(1), two = measured(2);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].value, two[i].value) << to_string(one[i].metric);
    ASSERT_EQ(one[i].distance_mm.size(), two[i].distance_mm.size());
    EXPECT_EQ(
        std::memcmp(one[i].distance_mm.data(), two[i].distance_mm.data(), 4 * one[i].distance_mm.size()), 0)
        << to_string(one[i].metric);
  }
}

TEST(Distances, OnePointIsEnoughForMetricsThatNeedNoMore) {
  PointCloud a, b;
  a.points = {{1, 2, 2}};
  b.points = {{0, 0, 0}};
  for (const Metric m :
       {Metric::kChamfer, Metric::kHausdorff, Metric::kPercentileHausdorff, Metric::kEarthMovers})
    EXPECT_NEAR(value(a, b, m), 3, 1e-6) << to_string(m);
}

TEST(Distances, RefuseBadClouds) {
  const PointCloud good = grid(5, 0);
  PointCloud bad = good;
  bad.points[3].y() = std::numeric_limits<float>::quiet_NaN();
  expect_input_error([&] { compare({}, DistanceReference(good), Metric::kChamfer); },
                     {"compared cloud", "no points"});
  expect_input_error([&] { DistanceReference{PointCloud{}}; }, {"reference cloud", "no points"});
  expect_input_error([&] { compare(bad, DistanceReference(good), Metric::kChamfer); },
                     {"compared cloud", "point 3", "finite"});
  expect_input_error([&] { DistanceReference{bad}; }, {"reference cloud", "point 3"});
  expect_input_error([&] { DistanceReference(TriangleMesh{}, 10); }, {"reference mesh", "no triangles"});
  expect_input_error([&] { DistanceReference(box_mesh({0, 0, 0}, {1, 1, 1}), 0); }, {"positive"});
  TriangleMesh broken = box_mesh({0, 0, 0}, {1, 1, 1});
  broken.vertices[2].x() = std::numeric_limits<float>::infinity();
  expect_input_error([&] { DistanceReference(broken, 10); }, {"reference mesh", "vertex 2"});
}

TEST(Distances, RefuseBadOptionsAndMetricsThatDoNotFit) {
  const PointCloud cloud = grid(3, 0);
  const DistanceReference reference(grid(2, 0));  // four points
  const auto refused = [&](Metric metric, auto set, const std::vector<std::string>& says) {
    DistanceOptions options;
    set(options);
    expect_input_error([&] { compare(cloud, reference, metric, options); }, says);
  };
  const auto nothing = [](DistanceOptions&) {};
  refused(Metric::kPlane, nothing, {"plane", "6 neighbours", "only 4 points"});
  refused(Metric::kCloudToMesh, nothing, {"cloud-to-mesh", "mesh"});
  refused(Metric::kQuadric, [](auto& o) { o.neighbours = 4; }, {"quadric", "6 neighbours"});
  refused(Metric::kPlane, [](auto& o) { o.neighbours = 2; }, {"neighbours", "3 to 64", "found 2"});
  refused(Metric::kPlane, [](auto& o) { o.neighbours = 65; }, {"neighbours", "found 65"});
  refused(Metric::kChamfer, [](auto& o) { o.percentile = 0; }, {"percentile"});
  refused(Metric::kChamfer, [](auto& o) { o.percentile = std::nan(""); }, {"percentile"});
  refused(Metric::kChamfer, [](auto& o) { o.percentile = 100.1; }, {"percentile"});
  refused(Metric::kChamfer, [](auto& o) { o.registration_mm = -1; }, {"registration_mm"});
  refused(Metric::kChamfer, [](auto& o) { o.m3c2_depth_mm = std::nan(""); }, {"m3c2_depth_mm"});
  refused(Metric::kChamfer, [](auto& o) { o.exact_assignment_points = 0; }, {"exact_assignment_points"});
}

}  // namespace
}  // namespace gantry
