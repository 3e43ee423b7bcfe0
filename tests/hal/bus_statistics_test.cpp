#include "gantry/hal/bus_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace gantry {
namespace {

TEST(RoundTripHistogram, EmptyIsZero) {
  const RoundTripHistogram empty;
  EXPECT_EQ(empty.count(), 0);
  EXPECT_EQ(empty.quantile_us(0.5), 0);
}

TEST(RoundTripHistogram, QuantilesAreThoseOfTheSortedSample) {
  std::mt19937 random(5);
  for (const double scale : {30.0, 3000.0, 1e6}) {
    std::lognormal_distribution<double> time_us(std::log(scale), 0.8);
    RoundTripHistogram histogram;
    std::vector<double> all;
    for (int i = 0; i < 5000; ++i) {
      all.push_back(time_us(random));
      histogram.add(all.back());
    }
    std::sort(all.begin(), all.end());
    EXPECT_EQ(histogram.count(), 5000);
    EXPECT_EQ(histogram.min_us(), all.front());
    EXPECT_EQ(histogram.max_us(), all.back());
    for (const double fraction : {0.01, 0.5, 0.9, 0.99}) {
      const double exact = all[static_cast<size_t>(fraction * 5000) - 1];
      EXPECT_NEAR(histogram.quantile_us(fraction), exact, 0.033 * exact + 1) << scale << " " << fraction;
    }
  }
}

TEST(RoundTripHistogram, EveryDurationStaysWithinItsBin) {
  for (double us = 0; us < 60e6; us = us * 1.03 + 1) {
    RoundTripHistogram histogram;
    histogram.add(us / 10);  // so that minimum and maximum do not clamp to the value itself
    histogram.add(us);
    histogram.add(us * 10);
    EXPECT_NEAR(histogram.quantile_us(0.5), us, 0.033 * us + 1);
  }
}

TEST(RoundTripHistogram, WhatIsLongerThanTheLastBinCountsAsTheLongest) {
  RoundTripHistogram histogram;
  histogram.add(1e15);
  EXPECT_EQ(histogram.count(), 1);
  EXPECT_EQ(histogram.max_us(), 1e15);
}

}  // namespace
}  // namespace gantry
