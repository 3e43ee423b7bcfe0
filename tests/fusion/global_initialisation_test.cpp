#include "gantry/fusion/global_initialisation.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <limits>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"
#include "global_initialisation/gnc.h"
#include "global_initialisation/k_core.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// A lump without symmetry: a ball of 40 mm with Gaussian hills and hollows, different for every seed.
struct Lump {
  explicit Lump(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> height(-9, 9);
    for (int i = 0; i < 25; ++i) hills.push_back({random_direction(random), height(random)});
  }
  Eigen::Vector3d at(const Eigen::Vector3d& direction) const {
    double radius = 40;
    for (const auto& [top, height] : hills) radius += height * std::exp((top.dot(direction) - 1) / 0.06);
    return radius * direction;
  }
  Eigen::Vector3d normal(const Eigen::Vector3d& direction) const {
    const Eigen::Vector3d u = direction.unitOrthogonal(), v = direction.cross(u);
    const double h = 1e-4;
    const auto along = [&](const Eigen::Vector3d& w) -> Eigen::Vector3d {
      return at((direction + h * w).normalized()) - at((direction - h * w).normalized());
    };
    return along(u).cross(along(v)).normalized();
  }
  std::vector<std::pair<Eigen::Vector3d, double>> hills;
};

/// What a sensor sees of the lump, in its frame: about 1300 points, with noise.
PointCloud view_of(const Lump& lump, const Pose& lump_from_sensor, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 0.1);
  const Eigen::Matrix3d turn = rotation_exp(random_direction(random));  // so that no two views share a point
  const Pose sensor_from_lump = lump_from_sensor.inverse();
  PointCloud cloud;
  const int count = 3600;
  for (int i = 0; i < count; ++i) {  // Fibonacci's sphere
    const double z = 1 - (2 * i + 1.0) / count, angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - z * z);
    const Eigen::Vector3d direction = turn * Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), z);
    const Eigen::Vector3d point = lump.at(direction), normal = lump.normal(direction);
    const Eigen::Vector3d ray = (lump_from_sensor.translation() - point).normalized();
    if (normal.dot(ray) < 0.3) continue;
    cloud.points.push_back((sensor_from_lump * (point + noise(random) * ray)).cast<float>());
    cloud.normals.push_back((sensor_from_lump.linear() * normal).cast<float>());
  }
  return cloud;
}

Pose lump_view(double azimuth_rad, double roll_rad) {
  const Pose pose = looking_at(400 * Eigen::Vector3d(std::cos(azimuth_rad), std::sin(azimuth_rad), 0.2),
                               Eigen::Vector3d::Zero());
  return pose * Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitZ());
}

PointCloud flat_patch() {
  PointCloud cloud;
  for (int y = -18; y <= 18; ++y)
    for (int x = -18; x <= 18; ++x) {
      cloud.points.push_back({2.f * static_cast<float>(x), 2.f * static_cast<float>(y), 400});
      cloud.normals.push_back({0, 0, -1});
    }
  return cloud;
}

TEST(GlobalInitialisation, FindsPartlyOverlappingViewsFromAnyPose) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Lump lump(seed);
    const Pose a = lump_view(0, 0), b = lump_view(65 * kDegree, 1.3 * seed);
    const auto proposals = propose_alignments(view_of(lump, a, 10 + seed), view_of(lump, b, 20 + seed));
    ASSERT_FALSE(proposals.empty()) << seed;
    const Pose truth = a.inverse() * b, found = proposals[0].target_from_source;
    EXPECT_LT(rotation_distance(found, truth), 2 * kDegree) << seed;
    const Eigen::Vector3d middle = b.inverse() * Eigen::Vector3d::Zero();
    EXPECT_LT((found * middle - truth * middle).norm(), 1) << seed;
    EXPECT_NEAR(proposals[0].inlier_fraction, 0.5, 0.2) << seed;
  }
}

TEST(GlobalInitialisation, ProposalsAreDistinctRigidAndAsManyAsAsked) {
  const Lump lump(1);
  GlobalInitialisationOptions options;
  options.max_proposals = 3;
  const auto source = view_of(lump, lump_view(1, 0), 2);
  const auto proposals = propose_alignments(view_of(lump, lump_view(0, 0), 1), source, options);
  ASSERT_EQ(proposals.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const Eigen::Matrix3d rotation = proposals[i].target_from_source.linear();
    EXPECT_LT((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(rotation.determinant(), 1, 1e-12);
    EXPECT_DOUBLE_EQ(proposals[i].inlier_fraction,
                     static_cast<double>(proposals[i].inliers) / static_cast<double>(source.size()));
    for (size_t j = 0; j < i; ++j) {
      const Pose &p = proposals[i].target_from_source, &q = proposals[j].target_from_source;
      EXPECT_TRUE(rotation_distance(p, q) > 9.9 * kDegree || (p.translation() - q.translation()).norm() > 2);
    }
  }
}

TEST(GlobalInitialisation, SameOnAnyNumberOfThreads) {
  const Lump lump(3);
  const auto target = view_of(lump, lump_view(0, 0), 1), source = view_of(lump, lump_view(1.2, 2), 2);
  std::vector<std::vector<PoseProposal>> runs;
  for (const size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    runs.push_back(propose_alignments(target, source));
  }
  for (size_t run = 1; run < runs.size(); ++run) {
    ASSERT_EQ(runs[run].size(), runs[0].size());
    for (size_t i = 0; i < runs[0].size(); ++i)
      EXPECT_TRUE(runs[run][i].target_from_source.matrix() == runs[0][i].target_from_source.matrix());
  }
}

TEST(GlobalInitialisation, APlaneSaysNothing) {
  EXPECT_TRUE(propose_alignments(flat_patch(), flat_patch()).empty());
  const auto lump = view_of(Lump(1), lump_view(0, 0), 1);
  for (const auto& proposal : propose_alignments(flat_patch(), lump))
    EXPECT_LT(proposal.inlier_fraction, 0.3);
}

TEST(GlobalInitialisation, NothingInCommonShowsInTheInlierFraction) {
  const auto target = view_of(Lump(5), lump_view(0, 0), 1), source = view_of(Lump(6), lump_view(0, 0), 2);
  const auto same = view_of(Lump(5), lump_view(0, 1), 3);
  const auto right = propose_alignments(target, same), wrong = propose_alignments(target, source);
  ASSERT_FALSE(right.empty());
  EXPECT_GT(right[0].inlier_fraction, 0.9);
  for (const auto& proposal : wrong) EXPECT_LT(proposal.inlier_fraction, 0.6);
}

TEST(GlobalInitialisation, EmptyAndTinyCloudsGiveNothing) {
  const auto lump = view_of(Lump(1), lump_view(0, 0), 1);
  PointCloud tiny;
  for (const size_t size : {0, 1, 3, 20}) {
    tiny.points.assign(lump.points.begin(), lump.points.begin() + static_cast<long>(size));
    tiny.normals.assign(lump.normals.begin(), lump.normals.begin() + static_cast<long>(size));
    EXPECT_TRUE(propose_alignments(tiny, lump).empty());
    EXPECT_TRUE(propose_alignments(lump, tiny).empty());
  }
}

TEST(GlobalInitialisation, BadInputIsNamed) {
  const auto good = view_of(Lump(1), lump_view(0, 0), 1);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  auto bad = good;
  bad.points[7].y() = nan;
  expect_input_error([&] { propose_alignments(good, bad); }, {"source", "point 7"});
  expect_input_error([&] { propose_alignments(bad, good); }, {"target", "point 7"});
  bad = good;
  bad.normals[9].x() = nan;
  expect_input_error([&] { propose_alignments(good, bad); }, {"source", "point 9"});
  bad = good;
  bad.normals[9] *= 2;
  expect_input_error([&] { propose_alignments(good, bad); }, {"normal", "unit"});
  bad.normals.clear();
  expect_input_error([&] { propose_alignments(good, bad); }, {"source", "no normals"});
  bad = good;
  for (auto& p : bad.points) p.z() -= 408;  // the sensor's frame lost: the origin is in the part
  expect_input_error([&] { propose_alignments(good, bad); }, {"sensor_at_origin"});
  GlobalInitialisationOptions options;
  options.noise_bound_mm = -1;
  expect_input_error([&] { propose_alignments(good, good, options); }, {"noise_bound_mm"});
  options = {};
  options.feature_radius_mm = nan;
  expect_input_error([&] { propose_alignments(good, good, options); }, {"feature_radius_mm"});
  options = {};
  options.max_normal_angle_rad = 0;
  expect_input_error([&] { propose_alignments(good, good, options); }, {"max_normal_angle_rad"});
  options = {};
  options.max_proposals = 0;
  expect_input_error([&] { propose_alignments(good, good, options); }, {"max_proposals"});
}

/// By definition: take away vertices with fewer than k neighbours until none is left to take.
std::vector<uint32_t> core_numbers_by_definition(const Adjacency& graph) {
  std::vector<uint32_t> numbers(graph.size(), 0);
  for (uint32_t k = 1; k <= graph.size(); ++k) {
    std::vector<bool> in(graph.size(), true);
    for (bool changed = true; changed;) {
      changed = false;
      for (size_t v = 0; v < graph.size(); ++v) {
        if (!in[v]) continue;
        uint32_t degree = 0;
        for (const uint32_t u : graph[v]) degree += in[u];
        if (degree < k) {
          in[v] = false;
          changed = true;
        }
      }
    }
    for (size_t v = 0; v < graph.size(); ++v)
      if (in[v]) numbers[v] = k;
  }
  return numbers;
}

TEST(KCore, AgreesWithItsDefinitionOnRandomGraphs) {
  std::mt19937 random(1);
  for (int round = 0; round < 60; ++round) {
    const size_t n = 1 + random() % 40;
    std::bernoulli_distribution edge(0.02 * static_cast<double>(round % 25));
    Adjacency graph(n);
    for (uint32_t i = 0; i < n; ++i)
      for (uint32_t j = i + 1; j < n; ++j)
        if (edge(random)) {
          graph[i].push_back(j);
          graph[j].push_back(i);
        }
    const auto numbers = core_numbers_by_definition(graph);
    EXPECT_EQ(core_numbers(graph), numbers);
    const uint32_t most = *std::max_element(numbers.begin(), numbers.end());
    std::vector<uint32_t> core;
    for (uint32_t v = 0; v < n; ++v)
      if (numbers[v] == most) core.push_back(v);
    EXPECT_EQ(maximal_core(graph), core);
  }
  EXPECT_TRUE(maximal_core({}).empty());
}

TEST(Gnc, FindsThePoseAmongEightyPercentOutliers) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> coordinate(-50, 50);
    std::normal_distribution<double> noise(0, 0.3);
    const auto point = [&] {
      return Eigen::Vector3d(coordinate(random), coordinate(random), coordinate(random));
    };
    const auto error = [&] { return Eigen::Vector3d(noise(random), noise(random), noise(random)); };
    const Pose truth = random_motion(random, {5, 6, 7}, 80, 2.5);
    std::vector<OrientedMatch> matches;
    std::vector<size_t> inliers;
    for (size_t i = 0; i < 200; ++i) {
      // A wrong match is another place of the same part.
      OrientedMatch m{truth * point(), random_direction(random), point(), random_direction(random)};
      if (i % 5 == 0) {
        m.target = truth * m.source + error();
        m.target_normal = (truth.linear() * m.source_normal + 0.1 * error()).normalized();
        inliers.push_back(i);
      }
      matches.push_back(m);
    }
    const auto result = align_by_gnc(matches, 2, 6);
    EXPECT_LT(rotation_distance(result.target_from_source, truth), 0.5 * kDegree) << seed;
    EXPECT_LT((result.target_from_source.translation() - truth.translation()).norm(), 0.5) << seed;
    EXPECT_EQ(result.inliers, inliers) << seed;
  }
}

TEST(Gnc, TooFewMatchesHaveNoInliers) {
  EXPECT_TRUE(align_by_gnc({}, 1, 1).inliers.empty());
  const OrientedMatch one{{1, 2, 3}, {1, 0, 0}, {1, 2, 3}, {1, 0, 0}};
  const std::vector<OrientedMatch> two(2, one);
  EXPECT_TRUE(align_by_gnc(two, 1, 1).inliers.empty());
}

}  // namespace
}  // namespace gantry
