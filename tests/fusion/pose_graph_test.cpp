#include "gantry/fusion/pose_graph.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>

#include "fusion/scenes.h"
#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr double kShiftSigmaMm = 0.5, kRotationSigmaRad = 0.005;

/// Four views of the bracket, every pair connected.
struct Graph {
  std::vector<Pose> truth;
  std::vector<UncertainPose> tagged;
  std::vector<Eigen::Vector3d> centres;
  std::vector<PoseGraphEdge> edges;
};

/// What an exact measurement with this standard deviation at the scan's centre states.
Matrix6d information_about(const Eigen::Vector3d& centre, double shift_mm, double rotation_rad) {
  return covariance_about(centre, shift_mm, rotation_rad).inverse();
}

/// Edges are exact and state `edge_sigma_mm`; tags are perturbed, but for the first.
Graph make_graph(double edge_sigma_mm, double tag_scale = 1) {
  Graph g;
  std::mt19937 random(21);
  for (int i = 0; i < 4; ++i) {
    g.truth.push_back(bracket_view(1.4 * i, 0.7));
    UncertainPose tag;
    tag.mean = g.truth.back();
    if (i > 0)
      tag.mean = random_motion(random, bracket_middle(), kShiftSigmaMm, kRotationSigmaRad) * tag.mean;
    tag.independent =
        covariance_about(bracket_middle(), tag_scale * kShiftSigmaMm, tag_scale * kRotationSigmaRad);
    g.tagged.push_back(tag);
    g.centres.push_back(g.truth.back().inverse() * bracket_middle());
  }
  for (size_t source = 1; source < 4; ++source)
    for (size_t target = 0; target < source; ++target) {
      PoseGraphEdge edge;
      edge.target = target;
      edge.source = source;
      edge.odometry = source == target + 1;
      edge.match.target_from_source = g.truth[target].inverse() * g.truth[source];
      edge.match.information = information_about(g.centres[target], edge_sigma_mm, 0.01 * edge_sigma_mm);
      edge.match.inliers = 1000;
      edge.match.converged = true;
      g.edges.push_back(edge);
    }
  return g;
}

double error_mm(const Graph& g, const PoseGraphResult& result, size_t i) {
  return (result.part_from_sensor[i].mean * g.centres[i] - g.truth[i] * g.centres[i]).norm();
}

PoseGraphResult solve(Graph& g) {
  return optimise_pose_graph(g.tagged, g.edges, g.centres, {});
}

TEST(PoseGraph, ExactEdgesGiveExactPoses) {
  Graph g = make_graph(1e-4);
  ASSERT_GT((g.tagged[1].mean * g.centres[1] - g.truth[1] * g.centres[1]).norm(), 0.4);
  const PoseGraphResult result = solve(g);
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.pruned, 0);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_LT(error_mm(g, result, i), 1e-4);
    EXPECT_LT(rotation_distance(result.part_from_sensor[i].mean, g.truth[i]), 1e-6);
  }
  for (const auto& edge : g.edges) EXPECT_LT(edge.disagreement_mm, 1e-4);
}

TEST(PoseGraph, TheFirstPoseIsTheGauge) {
  Graph g = make_graph(0.02);
  std::mt19937 random(2);
  g.tagged[0].mean = random_motion(random, bracket_middle(), 3, 0.02) * g.truth[0];
  const PoseGraphResult result = solve(g);
  EXPECT_TRUE(result.part_from_sensor[0].mean.isApprox(g.tagged[0].mean, 1e-14));
  EXPECT_EQ(result.part_from_sensor[0].covariance().norm(), 0);
}

TEST(PoseGraph, WithoutEdgesTheTagsStay) {
  Graph g = make_graph(0.02);
  g.edges.clear();
  const PoseGraphResult result = solve(g);
  for (size_t i = 0; i < 4; ++i)
    EXPECT_LT(translation_distance(result.part_from_sensor[i].mean, g.tagged[i].mean), 1e-6);
}

TEST(PoseGraph, AWrongEdgeIsPrunedAndSaysByHowMuch) {
  for (const double wrong_mm : {2.0, 20.0}) {
    Graph g = make_graph(0.02);
    std::mt19937 random(3);
    PoseGraphEdge& wrong = g.edges[2];
    wrong.match.target_from_source =
        random_motion(random, g.centres[wrong.target], wrong_mm, 0) * wrong.match.target_from_source;
    const PoseGraphResult result = solve(g);
    EXPECT_EQ(result.pruned, 1);
    for (size_t e = 0; e < g.edges.size(); ++e) EXPECT_EQ(g.edges[e].kept, e != 2) << e;
    EXPECT_NE(wrong.reason.find("mm"), std::string::npos) << wrong.reason;
    EXPECT_NEAR(wrong.disagreement_mm, wrong_mm, 0.1);
    for (size_t i = 0; i < 4; ++i) EXPECT_LT(error_mm(g, result, i), 0.01);
  }
}

TEST(PoseGraph, TheOrderOfTheEdgesDoesNotMatter) {
  Graph a = make_graph(0.02), b = make_graph(0.02);
  std::mt19937 random(4);
  for (auto& edge : a.edges)
    edge.match.target_from_source =
        random_motion(random, a.centres[edge.target], 0.03, 1e-4) * edge.match.target_from_source;
  b.edges = a.edges;
  std::shuffle(b.edges.begin(), b.edges.end(), random);
  const PoseGraphResult first = solve(a), second = solve(b);
  for (size_t i = 0; i < 4; ++i)
    EXPECT_LT((first.part_from_sensor[i].mean * a.centres[i] - second.part_from_sensor[i].mean * a.centres[i])
                  .norm(),
              1e-5);
}

TEST(PoseGraph, AnEdgeCannotDisagreeWhereItKnowsNothing) {
  PairwiseResult match;
  match.information.setZero();
  match.information(5, 5) = 1e6;  // holds along z alone
  Pose along = Pose::Identity(), off = Pose::Identity();
  along.translation() = Eigen::Vector3d(3, 0, 0);
  off.translation() = Eigen::Vector3d(0, 0, 3);
  EXPECT_LT(edge_disagreement_mm(match, along, Eigen::Vector3d::Zero(), 0.5), 1e-9);
  EXPECT_NEAR(edge_disagreement_mm(match, off, Eigen::Vector3d::Zero(), 0.5), 3, 1e-3);
}

TEST(PoseGraph, AWeakWrongLoopDoesNotBendTheChain) {
  Graph g = make_graph(0.02);
  // Scan 3 against scan 0 is a flat overlap: it holds along one direction and slid 20 mm along the others.
  for (auto& edge : g.edges) {
    if (edge.target != 0 || edge.source != 3) continue;
    edge.match.information.setZero();
    edge.match.information(5, 5) = 2500;
    Pose slid = Pose::Identity();
    slid.translation() = Eigen::Vector3d(20, 0, 0);
    edge.match.target_from_source = slid * edge.match.target_from_source;
  }
  const PoseGraphResult result = solve(g);
  EXPECT_EQ(result.pruned, 0);
  for (size_t i = 0; i < 4; ++i) EXPECT_LT(error_mm(g, result, i), 0.01);
}

TEST(PoseGraph, BadInputIsRejected) {
  Graph g = make_graph(0.02);
  EXPECT_THROW(optimise_pose_graph(g.tagged, g.edges, g.centres, {.edge_prune_threshold_mm = 0}), InputError);
  g.edges[0].source = 9;
  EXPECT_THROW(solve(g), InputError);
  EXPECT_THROW(optimise_pose_graph(g.tagged, g.edges, {}, {}), InputError);
}

TEST(PoseGraph, CovarianceIsWhatRepetitionShows) {
  constexpr double kEdgeSigmaMm = 0.05;
  constexpr int kRuns = 250;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> squares(4, 0), stated(4, 0);
  for (int run = 0; run < kRuns; ++run) {
    Graph g = make_graph(kEdgeSigmaMm, 100);  // tags that say next to nothing
    for (auto& edge : g.edges) {
      const Matrix6d factor = Matrix6d(edge.match.information.inverse()).llt().matrixL();
      Vector6d draw;
      for (int k = 0; k < 6; ++k) draw[k] = normal(random);
      edge.match.target_from_source = pose_exp(factor * draw) * edge.match.target_from_source;
    }
    const PoseGraphResult result = solve(g);
    for (size_t i = 1; i < 4; ++i) {
      squares[i] += std::pow(error_mm(g, result, i), 2);
      // The covariance of the centre's position, all three directions.
      Eigen::Matrix<double, 3, 6> j;
      j << -cross_matrix(g.truth[i] * g.centres[i]), Eigen::Matrix3d::Identity();
      stated[i] += (j * result.part_from_sensor[i].covariance() * j.transpose()).trace();
    }
  }
  for (size_t i = 1; i < 4; ++i) {
    const double ratio = std::sqrt(stated[i] / squares[i]);
    EXPECT_NEAR(ratio, 1, 0.15) << "scan " << i << ": stated " << std::sqrt(stated[i] / kRuns)
                                << " mm, found " << std::sqrt(squares[i] / kRuns) << " mm";
  }
}

}  // namespace
}  // namespace gantry
