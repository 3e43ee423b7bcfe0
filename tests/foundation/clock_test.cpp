#include "gantry/foundation/clock.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace gantry {
namespace {

TEST(VirtualClock, PassesExactlyWhatIsSlept) {
  VirtualClock clock;
  EXPECT_EQ(clock.now_s(), 0.0);
  clock.sleep_s(1.5);
  clock.sleep_s(0.25);
  EXPECT_EQ(clock.now_s(), 1.75);
}

TEST(VirtualClock, ADaySleptTakesNoTime) {
  SteadyClock real;
  VirtualClock clock;
  const double before = real.now_s();
  clock.sleep_s(86'400);
  EXPECT_LT(real.now_s() - before, 60.0);
  EXPECT_EQ(clock.now_s(), 86'400.0);
}

TEST(VirtualClock, NeverGoesBackwards) {
  VirtualClock clock;
  clock.sleep_s(2);
  clock.sleep_s(-1);
  EXPECT_EQ(clock.now_s(), 2.0);
}

TEST(VirtualClock, LosesNothingBetweenThreads) {
  VirtualClock clock;
  std::vector<std::jthread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 20'000; ++i) clock.sleep_s(0.5);  // a power of two: sums are exact
    });
  threads.clear();
  EXPECT_EQ(clock.now_s(), 4 * 20'000 * 0.5);
}

TEST(SteadyClock, SleepsAtLeastAsLongAsAsked) {
  SteadyClock clock;
  const double before = clock.now_s();
  clock.sleep_s(0.02);
  EXPECT_GE(clock.now_s() - before, 0.02);
  clock.sleep_s(-5);
  EXPECT_LT(clock.now_s() - before, 5.0);
}

}  // namespace
}  // namespace gantry
