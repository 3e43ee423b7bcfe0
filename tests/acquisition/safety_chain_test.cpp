#include "gantry/acquisition/safety_chain.h"

#include <gtest/gtest.h>

#include <cmath>

#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

constexpr double kCycle_s = 0.01;

SafetySettings demo_settings() {
  SafetySettings settings;
  settings.inputs = {{"emergency stop", {0, 1}, StopCategory::kCategory0, 0.1, 0.05},
                     {"door", {2, 3}, StopCategory::kCategory1, 0.5, 0.1},
                     {"light curtain", {4}, StopCategory::kCategory1, 0.1, 0.05}};
  settings.max_age_s = 0.1;
  settings.ramp_limit_s = 1;
  return settings;
}

/// The chain with readings every cycle.
class Rig {
 public:
  Rig() { snapshot_.closed.fill(true); }

  void set(size_t channel, bool closed) { snapshot_.closed[channel] = closed; }
  void set_door(bool closed) {
    set(2, closed);
    set(3, closed);
  }
  void set_emergency_stop(bool released) {
    set(0, released);
    set(1, released);
  }
  void stop_reading() { reading_ = false; }
  void read_again() { reading_ = true; }

  SafetyVerdict run(double duration_s, bool reset = false) {
    SafetyVerdict verdict;
    for (double t = 0; t < duration_s - 1e-9; t += kCycle_s) verdict = cycle(reset);
    return verdict;
  }
  SafetyVerdict cycle(bool reset = false) {
    now_s_ += kCycle_s;
    if (reading_) {
      snapshot_.valid = true;
      snapshot_.count = 5;
      snapshot_.sampled_at_s = now_s_;
    }
    return chain_.update(snapshot_, reset, now_s_);
  }
  /// All released, latched no more.
  void become_ready() {
    run(0.3);
    ASSERT_EQ(cycle(true).reset, SafetyReset::kAccepted);
    ASSERT_TRUE(cycle().motion_allowed);
  }
  const SafetySettings& settings() const { return chain_.settings(); }

 private:
  SafetyChain chain_{demo_settings()};
  SafetyInputsSnapshot snapshot_;
  double now_s_ = 100;
  bool reading_ = true;
};

TEST(SafetyChain, StartsLatchedAndMovesOnlyAfterAResetEdge) {
  Rig rig;
  SafetyVerdict verdict = rig.cycle(true);  // a reset button that is stuck
  EXPECT_EQ(verdict.stop, StopCategory::kCategory0);
  EXPECT_EQ(verdict.reset, SafetyReset::kNone) << "a level is no edge";
  verdict = rig.run(1, true);
  EXPECT_EQ(verdict.stop, StopCategory::kCategory0);
  EXPECT_EQ(verdict.cause, SafetyCause::kResetNeeded);
  EXPECT_EQ(verdict.latched_by, SafetyCause::kStart);
  EXPECT_EQ(describe(verdict, rig.settings()), "waiting for a reset because the program has started");
  rig.cycle(false);
  verdict = rig.cycle(true);
  EXPECT_EQ(verdict.reset, SafetyReset::kAccepted);
  EXPECT_TRUE(verdict.motion_allowed);
  EXPECT_EQ(describe(verdict, rig.settings()), "the safety chain is closed");
}

TEST(SafetyChain, AResetIsRefusedWhileAnInputIsTrippedAndForgotten) {
  Rig rig;
  rig.set_door(false);
  rig.run(1);
  SafetyVerdict verdict = rig.cycle(true);
  EXPECT_EQ(verdict.reset, SafetyReset::kRefused);
  EXPECT_EQ(describe(verdict, rig.settings()), "door is tripped; release it, then reset");
  rig.set_door(true);
  verdict = rig.run(1, true);
  EXPECT_FALSE(verdict.motion_allowed) << "the level of the refused edge must not count later";
  rig.cycle(false);
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kAccepted);
}

TEST(SafetyChain, TheFirstReadingThatShowsATripStops) {
  Rig rig;
  rig.become_ready();
  rig.set(0, false);  // one channel is enough
  const SafetyVerdict verdict = rig.cycle();
  EXPECT_EQ(verdict.stop, StopCategory::kCategory0);
  EXPECT_EQ(verdict.cause, SafetyCause::kTripped);
  EXPECT_EQ(verdict.input, 0);
}

TEST(SafetyChain, ReleasingDoesNotStartAnything) {
  Rig rig;
  rig.become_ready();
  rig.set_emergency_stop(false);
  rig.cycle();
  rig.set_emergency_stop(true);
  const SafetyVerdict verdict = rig.run(10);
  EXPECT_EQ(verdict.stop, StopCategory::kCategory0);
  EXPECT_EQ(describe(verdict, rig.settings()), "waiting for a reset because emergency stop was tripped");
}

TEST(SafetyChain, CategoryOneRampsAndThenTakesTheTorque) {
  Rig rig;
  rig.become_ready();
  rig.set_door(false);
  EXPECT_EQ(rig.cycle().stop, StopCategory::kCategory1);
  EXPECT_EQ(rig.run(0.9).stop, StopCategory::kCategory1);
  EXPECT_EQ(rig.run(0.2).stop, StopCategory::kCategory0) << "the ramp limit is 1 s";
}

TEST(SafetyChain, AResetDoesNotCutTheRampShort) {
  Rig rig;
  rig.become_ready();
  rig.set_door(false);
  rig.cycle();
  rig.set_door(true);
  SafetyVerdict verdict = rig.run(0.5);
  EXPECT_EQ(verdict.cause, SafetyCause::kStopping);
  EXPECT_EQ(describe(verdict, rig.settings()),
            "stopping because door was tripped; reset when the stop has ended");
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kRefused);
  EXPECT_EQ(rig.run(0.6).stop, StopCategory::kCategory0);
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kAccepted);
}

TEST(SafetyChain, TheHighestCategoryWinsAndStays) {
  Rig rig;
  rig.become_ready();
  rig.set_door(false);
  EXPECT_EQ(rig.cycle().stop, StopCategory::kCategory1);
  rig.set_emergency_stop(false);
  EXPECT_EQ(rig.cycle().stop, StopCategory::kCategory0);
  rig.set_emergency_stop(true);
  EXPECT_EQ(rig.run(0.3).stop, StopCategory::kCategory0) << "not back to a ramp";
}

TEST(SafetyChain, StaleReadingsTripEverythingAndNameTheModule) {
  Rig rig;
  rig.become_ready();
  rig.stop_reading();
  EXPECT_TRUE(rig.run(0.09).motion_allowed);
  const SafetyVerdict verdict = rig.run(0.03);
  EXPECT_EQ(verdict.stop, StopCategory::kCategory0) << "the highest of all inputs";
  EXPECT_EQ(verdict.cause, SafetyCause::kNoData);
  EXPECT_NE(describe(verdict, rig.settings()).find("100 ms; is the I/O module powered"), std::string::npos);
  rig.read_again();
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kRefused) << "one good reading is not enough";
  rig.run(0.2);
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kAccepted);
}

TEST(SafetyChain, OneChannelAloneIsAFaultThatOnlyAFullTripAndReleaseClears) {
  Rig rig;
  rig.become_ready();
  rig.set(0, false);
  SafetyVerdict verdict = rig.run(0.1);
  EXPECT_EQ(verdict.cause, SafetyCause::kTripped) << "within the discrepancy time";
  verdict = rig.run(0.03);
  EXPECT_EQ(verdict.cause, SafetyCause::kDiscrepancy);
  EXPECT_NE(describe(verdict, rig.settings()).find("trip and release emergency stop once"),
            std::string::npos);
  rig.set(0, true);  // the wire makes contact again: that proves nothing
  verdict = rig.run(5);
  EXPECT_EQ(verdict.cause, SafetyCause::kDiscrepancy);
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kRefused);
  rig.set(1, false);  // the other one alone proves nothing either
  rig.run(0.05);
  rig.set(1, true);
  EXPECT_EQ(rig.run(1).cause, SafetyCause::kDiscrepancy);
  rig.set_emergency_stop(false);
  EXPECT_EQ(rig.run(0.02).cause, SafetyCause::kDiscrepancy);
  rig.set_emergency_stop(true);
  EXPECT_EQ(rig.run(0.2).cause, SafetyCause::kResetNeeded);
  rig.cycle(false);
  EXPECT_EQ(rig.cycle(true).reset, SafetyReset::kAccepted);
}

TEST(SafetyChain, BouncingWhileClosingIsWaitedOut) {
  Rig rig;
  rig.become_ready();
  rig.set_door(false);
  rig.run(2);
  for (int k = 0; k < 20; ++k) {
    rig.set_door(k % 2 == 0);
    EXPECT_EQ(rig.run(0.05).cause, SafetyCause::kTripped) << "the door needs 0.1 s in one piece";
  }
  rig.set_door(true);
  EXPECT_EQ(rig.run(0.15).cause, SafetyCause::kResetNeeded);
}

TEST(SafetyChain, OneReadingKeptFreshIsNoProofOfARelease) {
  SafetyChain chain(demo_settings());
  SafetyInputsSnapshot once;
  once.valid = true;
  once.count = 5;
  once.closed.fill(true);
  once.sampled_at_s = 1;
  for (double now_s = 1; now_s < 1.09; now_s += kCycle_s)
    EXPECT_EQ(chain.update(once, false, now_s).cause, SafetyCause::kTripped) << "at " << now_s;
}

TEST(SafetyChain, NonsenseOfTimeAndSizeIsStale) {
  const double nan = std::nan("");
  for (const double sampled_at_s : {nan, -1e9, 1e9, 10.2}) {
    SafetyChain chain(demo_settings());
    SafetyInputsSnapshot snapshot;
    snapshot.valid = true;
    snapshot.count = 5;
    snapshot.closed.fill(true);
    snapshot.sampled_at_s = sampled_at_s;
    EXPECT_EQ(chain.update(snapshot, false, 10).cause, SafetyCause::kNoData) << sampled_at_s;
    snapshot.sampled_at_s = 10;
    EXPECT_EQ(chain.update(snapshot, false, nan).cause, SafetyCause::kNoData);
    snapshot.count = 4;
    EXPECT_EQ(chain.update(snapshot, false, 10).cause, SafetyCause::kNoData);
  }
}

/// One door of two channels and category 1, read at times that have exact binary fractions.
SafetySettings exact_settings() {
  SafetySettings settings;
  settings.inputs = {{"door", {0, 1}, StopCategory::kCategory1, 0.25, 0}};
  settings.max_age_s = 10;
  settings.ramp_limit_s = 0.5;
  return settings;
}

SafetyVerdict update_exactly(SafetyChain& chain, bool first, bool second, bool reset, double now_s) {
  SafetyInputsSnapshot snapshot;
  snapshot.valid = true;
  snapshot.count = 2;
  snapshot.closed = {first, second};
  snapshot.sampled_at_s = now_s;
  return chain.update(snapshot, reset, now_s);
}

TEST(SafetyChain, ATimeLimitItselfIsAllowedAndAnythingLongerIsNot) {
  SafetyChain chain(exact_settings());
  update_exactly(chain, true, true, false, 0);
  ASSERT_EQ(update_exactly(chain, true, true, true, 1).stop, StopCategory::kNone);
  update_exactly(chain, false, true, false, 2);
  EXPECT_EQ(update_exactly(chain, false, true, false, 2.25).cause, SafetyCause::kTripped);
  EXPECT_EQ(update_exactly(chain, false, true, false, 2.25 + 1e-6).cause, SafetyCause::kDiscrepancy);
  EXPECT_EQ(update_exactly(chain, false, true, false, 2.5).stop, StopCategory::kCategory1);
  EXPECT_EQ(update_exactly(chain, false, true, false, 2.5 + 1e-6).stop, StopCategory::kCategory0);
}

TEST(SafetyChain, ATimeThatIsNoNumberEndsTheRamp) {
  SafetyChain chain(exact_settings());
  update_exactly(chain, true, true, false, 0);
  ASSERT_EQ(update_exactly(chain, true, true, true, 1).stop, StopCategory::kNone);
  ASSERT_EQ(update_exactly(chain, false, false, false, 2).stop, StopCategory::kCategory1);
  EXPECT_EQ(update_exactly(chain, false, false, false, std::nan("")).stop, StopCategory::kCategory0);
}

TEST(SafetyChain, SettingsThatContradictThemselvesAreRefused) {
  const auto refused = [](auto edit, const std::vector<std::string>& parts) {
    SafetySettings settings = demo_settings();
    edit(settings);
    expect_input_error([&] { SafetyChain chain(settings); }, parts);
  };
  refused([](SafetySettings& s) { s.inputs.clear(); }, {"at least one input"});
  refused([](SafetySettings& s) { s.inputs[1].name = "emergency stop"; }, {"emergency stop", "differ"});
  refused([](SafetySettings& s) { s.inputs[1].channels = {1, 3}; }, {"door", "channel 1", "twice"});
  refused([](SafetySettings& s) { s.inputs[1].channels = {2, 3, 5}; }, {"door", "one or two"});
  refused([](SafetySettings& s) { s.inputs[2].channels = {70000}; }, {"light curtain", "65535"});
  refused([](SafetySettings& s) { s.inputs[2].stop = StopCategory::kNone; }, {"light curtain", "category"});
  refused([](SafetySettings& s) { s.inputs[0].discrepancy_s = -1; }, {"discrepancy_s"});
  refused([](SafetySettings& s) { s.inputs[0].release_s = std::nan(""); }, {"release_s"});
  refused([](SafetySettings& s) { s.max_age_s = 0; }, {"max_age_s"});
  refused([](SafetySettings& s) { s.ramp_limit_s = -1; }, {"ramp_limit_s"});
}

}  // namespace
}  // namespace gantry
