#include "gantry/hal/drive_channel.h"

#include <gtest/gtest.h>

#include "hal/fake_drive.h"

namespace gantry {
namespace {

using Calls = std::vector<std::string>;

class DriveChannelTest : public testing::Test {
 protected:
  DriveChannelTest() { drive.clock = &clock; }
  Fault lost() const { return {FaultKind::kTimeout, "axis tilt", "no answer"}; }

  VirtualClock clock;
  FakeDrive drive;
  DriveChannel channel{drive, clock, 5};
};

TEST_F(DriveChannelTest, PostingTouchesNothingAndServiceKeepsTheOrder) {
  EXPECT_FALSE(channel.latest().read);
  ASSERT_TRUE(channel.post({DriveAction::kServoOn, {}}));
  ASSERT_TRUE(channel.post({DriveAction::kHome, {}}));
  ASSERT_TRUE(channel.post({DriveAction::kMove, {12, 3, 4}}));
  EXPECT_TRUE(drive.calls.empty());
  drive.status.position = 1;
  channel.service();
  EXPECT_EQ(drive.calls, (Calls{"servo on", "home", "move"}));
  EXPECT_EQ(drive.last_move.target, 7) << "home is at 5 in axis coordinates";
  EXPECT_EQ(channel.latest().status.position, 6);
  EXPECT_EQ(channel.latest().executed, 3u);
  EXPECT_EQ(channel.posted(), 3u);
}

TEST_F(DriveChannelTest, HaltAndTorqueOffOvertakeAndVoidWhatWaits) {
  for (const DriveAction urgent : {DriveAction::kHalt, DriveAction::kServoOff}) {
    drive.calls.clear();
    channel.post({DriveAction::kHome, {}});
    channel.post({DriveAction::kMove, {1, 1, 1}});
    channel.post({urgent, {}});
    channel.post({DriveAction::kResetAlarm, {}});
    channel.service();
    EXPECT_EQ(drive.calls, (Calls{urgent == DriveAction::kHalt ? "halt" : "servo off", "reset alarm"}));
    EXPECT_EQ(channel.latest().executed, channel.posted());
  }
}

TEST_F(DriveChannelTest, AFullQueueRefusesButNeverAHalt) {
  for (size_t i = 0; i < DriveChannel::kCapacity; ++i) ASSERT_TRUE(channel.post({DriveAction::kHome, {}}));
  EXPECT_FALSE(channel.post({DriveAction::kHome, {}}));
  EXPECT_TRUE(channel.post({DriveAction::kHalt, {}}));
  channel.service();
  EXPECT_EQ(drive.calls, Calls{"halt"});
}

TEST_F(DriveChannelTest, AHaltIsOwedUntilTheDriveHasTakenIt) {
  drive.faults["halt"] = lost();
  channel.post({DriveAction::kHalt, {}});
  channel.post({DriveAction::kServoOn, {}});
  channel.service();
  EXPECT_EQ(drive.calls, Calls{"halt"}) << "nothing goes past a halt that failed";
  EXPECT_EQ(channel.latest().faults, 1u);
  EXPECT_EQ(channel.last_fault().message, "no answer");
  channel.service();
  EXPECT_EQ(drive.calls, (Calls{"halt", "halt"}));
  drive.faults.clear();
  drive.calls.clear();
  channel.service();
  channel.service();
  EXPECT_EQ(drive.calls, Calls{"halt"}) << "once, and the servo command is void";
  EXPECT_EQ(channel.latest().faults, 2u);
}

TEST_F(DriveChannelTest, ACommandThatFailsVoidsThoseBehindIt) {
  drive.faults["servo on"] = lost();
  channel.post({DriveAction::kServoOn, {}});
  channel.post({DriveAction::kMove, {1, 1, 1}});
  channel.service();
  drive.faults.clear();
  channel.service();
  EXPECT_EQ(drive.calls, Calls{"servo on"});
  EXPECT_EQ(channel.latest().executed, 2u) << "readings are news again";
}

TEST_F(DriveChannelTest, AReadingThatFailsKeepsTheOldOneAndCounts) {
  clock.sleep_s(1);
  channel.service();
  clock.sleep_s(2);
  drive.read_fault = lost();
  channel.service();
  const DriveSnapshot snapshot = channel.latest();
  EXPECT_EQ(snapshot.status.sampled_at_s, 1);
  EXPECT_EQ(snapshot.age_s(clock.now_s()), 2);
  EXPECT_EQ(snapshot.faults, 1u);
  EXPECT_EQ(snapshot.last_fault, FaultKind::kTimeout);
}

TEST_F(DriveChannelTest, ALoopThatStandsStillHasItsDriveHaltedOnceAStall) {
  LoopHeartbeat loop;
  loop.beat(0);
  channel.watch(&loop, 0.2, nullptr);
  channel.service();
  EXPECT_TRUE(drive.calls.empty());
  clock.sleep_s(0.21);
  channel.post({DriveAction::kMove, {1, 1, 1}});
  channel.service();
  channel.service();
  EXPECT_EQ(drive.calls, Calls{"halt"}) << "and what the loop had wanted is void";
  EXPECT_EQ(channel.latest().stalls, 1u);
  loop.beat(clock.now_s());
  channel.service();
  clock.sleep_s(0.3);
  channel.service();
  EXPECT_EQ(channel.latest().stalls, 2u);
}

}  // namespace
}  // namespace gantry
