#include "joint/solution.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gantry::internal {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Two scans at rest that fit as well as the noise lets them.
struct Settled {
  std::vector<RangeSurface> scans = std::vector<RangeSurface>(2);
  JointProblem problem;
  Attempt attempt;
  Solution solution;

  Settled() {
    problem.scans = scans;
    problem.noise_mm = 0.05;
    problem.spacing_mm = 0.2;
    problem.radius_mm = 80;
    attempt.sigma_mm = 0.06;
    attempt.left_out.resize(2);
    solution.last_step_mm = 0.001;
    solution.leave_one_out_mm = {0.01, 0.01};
    solution.from_tags.own = {0, 3};
    solution.covariance.assign(2, 1e-10 * Matrix6d::Identity());
  }
  bool believed() const {
    return objection_to_all(problem, attempt, solution).empty() &&
           objections_to(problem, attempt, solution).empty();
  }
};

TEST(Solution, WhatIsAtRestAndFitsIsBelieved) {
  const Settled settled;
  EXPECT_TRUE(at_rest(settled.problem, settled.solution));
  EXPECT_TRUE(settled.believed());
}

TEST(Solution, IsAtRestWhenTheLastRoundMovedLessThanAFifthOfTheNoise) {
  Settled s;
  for (const auto& [step_mm, rests] : {std::pair(0.0099, true), {0.0101, false}, {kNaN, false}}) {
    s.solution.last_step_mm = step_mm;
    EXPECT_EQ(at_rest(s.problem, s.solution), rests) << step_mm;
    EXPECT_EQ(s.believed(), rests);
  }
  s.solution.last_step_mm = 0.0101;
  EXPECT_NE(objection_to_all(s.problem, s.attempt, s.solution).find("not come to rest"), std::string::npos);
  // However little noise there is, nobody sees less than 5 um.
  s.problem.noise_mm = 0.001;
  s.solution.last_step_mm = 0.0049;
  EXPECT_TRUE(at_rest(s.problem, s.solution));
}

TEST(Solution, ResidualsHaveACeiling) {
  Settled s;  // ten times the noise is 0.5 mm, two pitches are 0.4 mm
  for (const auto& [sigma_mm, fits] : {std::pair(0.49, true), {0.51, false}, {kNaN, false}}) {
    s.attempt.sigma_mm = sigma_mm;
    EXPECT_EQ(objection_to_all(s.problem, s.attempt, s.solution).empty(), fits) << sigma_mm;
  }
  s.attempt.sigma_mm = 0.51;
  EXPECT_NE(objection_to_all(s.problem, s.attempt, s.solution).find("do not fit each other"),
            std::string::npos);
  s.problem.spacing_mm = 0.3;
  EXPECT_TRUE(objection_to_all(s.problem, s.attempt, s.solution).empty());
}

TEST(Solution, WhatIsNoNumberIsObjectedTo) {
  for (const double value : {kNaN, std::numeric_limits<double>::infinity()}) {
    Settled s;
    s.solution.leave_one_out_mm[0] = value;
    EXPECT_FALSE(s.believed());
    s = Settled();
    s.solution.from_tags.own[1] = value;
    EXPECT_FALSE(s.believed());
    s = Settled();
    s.solution.covariance[1](2, 2) = value;
    EXPECT_FALSE(s.believed());
  }
}

TEST(Solution, TheWorstContradictionIsNamedAlone) {
  Settled s;
  s.solution.leave_one_out_mm = {0.3, 0.6};
  const Objections objections = objections_to(s.problem, s.attempt, s.solution);
  ASSERT_EQ(objections.size(), 1u);
  EXPECT_EQ(objections[0].first, 1u);
  EXPECT_NE(objections[0].second.find("0.60 mm"), std::string::npos) << objections[0].second;
}

TEST(MatchMemory, FollowsHowMuchEdgesAreBroken) {
  // Residuals of edges against faces grow by as much as edges are found to be broken more.
  const std::vector<RangeSurface> scans(2);
  JointProblem problem;
  problem.scans = scans;
  problem.noise_mm = 0.05;
  problem.radius_mm = 80;
  const Poses poses(2, Pose::Identity());
  const auto sums_at = [](double break_mm) {
    RawSums sums;
    PairSum& face = sums.faces[3];
    for (int i = 0; i < 20; ++i) {
      const double at = 0.3 * i, residual = 0.1 * std::sin(at) + break_mm, weight = 1 + 0.5 * std::cos(at);
      const Eigen::Vector3d arm(std::cos(at), 2 * std::sin(2 * at), at),
          direction = Eigen::Vector3d(1, 0.2 * std::sin(at), 0.1).normalized();
      face.add(arm, direction, residual, weight);
      face.cost += weight * residual * residual;
      face.offset += weight * residual;
      face.directions.head<3>() += weight * arm.cross(direction);
      face.directions.tail<3>() += weight * direction;
    }
    return sums;
  };
  MatchGates gates;
  gates.edges.break_mm = 0.1;
  MatchMemory memory;
  memory.keep(0, 1, poses, gates, sums_at(0.1));
  gates.edges.break_mm = 0.35;
  RawSums recalled;
  ASSERT_TRUE(memory.recall(problem, 0, 1, poses, gates, recalled));
  const PairSum expected = sums_at(0.35).faces[3], found = recalled.faces[3];
  EXPECT_LT((found.gradient - expected.gradient).norm(), 1e-12 * expected.gradient.norm());
  EXPECT_NEAR(found.cost, expected.cost, 1e-12);
  EXPECT_NEAR(found.offset, expected.offset, 1e-12);
}

}  // namespace
}  // namespace gantry::internal
