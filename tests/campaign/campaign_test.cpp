#include "campaign.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "random_schedule.h"

namespace gantry {
namespace {

const CampaignCell& setup() {
  static const CampaignCell cell = read_campaign_cell(GANTRY_SOURCE_DIR "/examples/cells/simulated.yaml");
  return cell;
}

/// A safety chain that is always content.
class LyingPermit final : public MotionPermit {
 public:
  StopCategory required_stop(double, bool) override { return StopCategory::kNone; }
  std::string why() const override { return "nothing"; }
};

TEST(Campaign, ACellWithoutFaultsRunsInOneAttempt) {
  FaultSchedule quiet;
  const PlayResult played = play(setup(), quiet);
  EXPECT_FALSE(played.violation);
  EXPECT_EQ(played.attempts, 1);
  EXPECT_EQ(played.scans, 3);
}

TEST(Campaign, FindsAPermitThatLiesAndShrinksTheSchedule) {
  CampaignHooks hooks;
  hooks.wrap_permit = [](MotionPermit&) { return std::make_unique<LyingPermit>(); };
  const CampaignResult result = run_campaign(setup(), {64, 0, 1}, hooks);
  const auto found = std::find_if(result.failures.begin(), result.failures.end(),
                                  [](const CampaignFailure& f) { return f.violation.invariant == "torque"; });
  ASSERT_NE(found, result.failures.end());
  EXPECT_LE(found->shrunk.entries.size(), 2u);
  EXPECT_EQ(found->shrunk.entries[0].device, FaultDevice::kSafety);
}

TEST(Campaign, PlaysTheSameScheduleInTheSameWay) {
  for (uint64_t k = 0; k < 10; ++k) {
    const FaultSchedule schedule = random_schedule(schedule_seed(5, k), fault_targets(setup().cell));
    const PlayResult first = play(setup(), schedule), second = play(setup(), schedule);
    EXPECT_EQ(first.story, second.story);
    EXPECT_EQ(first.simulated_s, second.simulated_s);
  }
}

TEST(Campaign, ShortOneHolds) {
  const CampaignResult result = run_campaign(setup(), {300, 0, 1});
  for (const CampaignFailure& failure : result.failures)
    ADD_FAILURE() << "schedule " << failure.index << ": " << failure.violation.invariant << ": "
                  << failure.violation.detail;
  EXPECT_EQ(result.kinds.size(), fault_modes().size());  // Every kind was played.
  EXPECT_GT(result.attempts, 400u);                      // And the faults bit.
}

// Found by a campaign: a program that starts on a cell whose drives still have torque left it to them.
TEST(Campaign, AnAxisPoweredBeforeTheProgramBeganLosesItsTorqueWithTheChain) {
  FaultSchedule schedule;
  schedule.seed = 7;
  FaultEntry silent, press;
  silent.at_s = 3;
  silent.for_s = 4;
  silent.name = "linear";
  silent.mode = FaultMode::kSilent;
  press.at_s = 7;
  press.for_s = 0.2;
  press.device = FaultDevice::kSafety;
  press.name = "emergency stop";
  press.mode = FaultMode::kPress;
  schedule.entries = {silent, press};
  const PlayResult played = play(setup(), schedule);
  EXPECT_FALSE(played.violation) << played.violation->detail;
}

}  // namespace
}  // namespace gantry
