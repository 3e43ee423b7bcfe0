#include "series/probability.h"

#include <gtest/gtest.h>

namespace gantry::series {
namespace {

// Percentage points as in Montgomery, "Introduction to Statistical Quality Control", appendices III to V.
TEST(Probability, ChiSquareAsInTheTables) {
  EXPECT_NEAR(chi_square_quantile(0.95, 1), 3.8415, 1e-4);
  EXPECT_NEAR(chi_square_quantile(0.975, 9), 19.0228, 1e-4);
  EXPECT_NEAR(chi_square_quantile(0.025, 9), 2.7004, 1e-4);
  EXPECT_NEAR(chi_square_quantile(0.99, 60), 88.3794, 1e-4);
  EXPECT_NEAR(chi_square_quantile(0.025, 100), 74.2219, 1e-4);
}

TEST(Probability, StudentAsInTheTables) {
  EXPECT_NEAR(student_quantile(0.975, 1), 12.7062, 1e-4);
  EXPECT_NEAR(student_quantile(0.975, 8), 2.3060, 1e-4);
  EXPECT_NEAR(student_quantile(0.975, 30), 2.0423, 1e-4);
  EXPECT_NEAR(student_quantile(0.975, 1e6), 1.95996, 1e-4);
}

TEST(Probability, FisherAsInTheTables) {
  EXPECT_NEAR(fisher_above(4.9646, 1, 10), 0.05, 1e-5);
  EXPECT_NEAR(fisher_above(3.3258, 5, 10), 0.05, 1e-5);
  EXPECT_NEAR(fisher_above(2.3479, 10, 20), 0.05, 1e-5);
  EXPECT_NEAR(fisher_above(5.6363, 5, 10), 0.01, 1e-5);
  EXPECT_EQ(fisher_above(0, 3, 7), 1);
  // F with one freedom above is Student's t squared.
  const double t = student_quantile(0.975, 12);
  EXPECT_NEAR(fisher_above(t * t, 1, 12), 0.05, 1e-10);
}

TEST(Probability, QuantilesInvert) {
  for (const double freedoms : {0.62, 1.0, 2.5, 17.0, 400.0})
    for (const double p : {0.001, 0.025, 0.5, 0.975, 0.999})
      EXPECT_NEAR(chi_square_below(chi_square_quantile(p, freedoms), freedoms), p, 1e-9);
}

}  // namespace
}  // namespace gantry::series
