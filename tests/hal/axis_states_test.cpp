// The table of transitions: what it says, that the state machine does nothing else, and that the
// documentation shows it as it is.

#include "gantry/hal/axis_states.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "gantry/hal/axis_machine.h"
#include "hal/fake_drive.h"

namespace gantry {
namespace {

using enum AxisState;
using enum AxisTrigger;

/// PLCopen's rules for our six states, written down a second time.
const std::map<AxisTrigger, std::map<AxisState, AxisState>> kLegal = {
    {kEnable, {{kDisabled, kDisabled}}},
    {kDisable, {{kDisabled, kDisabled}, {kStandstill, kDisabled}}},
    {kHome, {{kStandstill, kHoming}}},
    {kMove, {{kStandstill, kDiscreteMotion}}},
    {kJog, {{kStandstill, kDiscreteMotion}}},
    {kStop,
     {{kStandstill, kStopping}, {kHoming, kStopping}, {kDiscreteMotion, kStopping}, {kStopping, kStopping}}},
    {kReset, {{kErrorStop, kErrorStop}}},
    {kPowered, {{kDisabled, kStandstill}}},
    {kDone, {{kHoming, kStandstill}, {kDiscreteMotion, kStandstill}, {kStopping, kStandstill}}},
    {kCleared, {{kErrorStop, kDisabled}}},
    {kFault,
     {{kDisabled, kErrorStop},
      {kStandstill, kErrorStop},
      {kHoming, kErrorStop},
      {kDiscreteMotion, kErrorStop},
      {kStopping, kErrorStop},
      {kErrorStop, kErrorStop}}},
};

TEST(AxisStates, TheTableIsThatOfPlcopen) {
  size_t lines = 0;
  for (const auto& [trigger, legal] : kLegal) {
    for (const AxisState from : kAxisStates) {
      const auto expected = legal.find(from);
      const auto next = next_state(from, trigger);
      EXPECT_EQ(next.has_value(), expected != legal.end()) << to_string(from) << " " << to_string(trigger);
      if (next && expected != legal.end()) {
        EXPECT_EQ(*next, expected->second);
      }
    }
    lines += legal.size();
  }
  EXPECT_EQ(std::size(kAxisTransitions), lines) << "no line twice";
}

/// A machine brought into a state by legal commands, on a drive at rest and homed.
class Rig {
 public:
  explicit Rig(AxisState state) {
    drive.clock = &clock;
    drive.status.homed = true;
    step();
    if (state != kDisabled) {
      machine.enable(clock.now_s());
      step();
    }
    if (state == kHoming) machine.home(clock.now_s());
    if (state == kDiscreteMotion) machine.move({50, 10, 100}, clock.now_s());
    if (state == kStopping) machine.stop(clock.now_s());
    if (state == kErrorStop)
      machine.abort({AxisReason::kOperator}, AxisMachine::Torque::kKeep, clock.now_s());
  }

  void step() {
    clock.sleep_s(0.01);
    channel.service();
    machine.step(channel.latest(), clock.now_s());
  }

  AxisRefusal command(AxisTrigger trigger) {
    const double now_s = clock.now_s();
    switch (trigger) {
      case kEnable:
        return machine.enable(now_s);
      case kDisable:
        return machine.disable(now_s);
      case kHome:
        return machine.home(now_s);
      case kMove:
        return machine.move({50, 10, 100}, now_s);
      case kJog:
        return machine.jog({50, 10, 100}, now_s);
      case kStop:
        return machine.stop(now_s);
      default:
        return machine.reset(now_s);
    }
  }

  VirtualClock clock;
  FakeDrive drive;
  DriveChannel channel{drive, clock};
  AxisMachine machine{AxisKind::kLinear, kFakeLimits, channel};
};

class EveryStateAndCommand : public testing::TestWithParam<std::tuple<AxisState, AxisTrigger>> {};

TEST_P(EveryStateAndCommand, IsTakenOrRefusedAsTheTableSays) {
  const auto [state, trigger] = GetParam();
  Rig rig(state);
  ASSERT_EQ(rig.machine.state(), state);
  const uint64_t posted = rig.channel.posted();
  EXPECT_EQ(rig.machine.check(trigger) == AxisRefusal::kNone, next_state(state, trigger).has_value());
  const AxisRefusal refusal = rig.command(trigger);
  const auto& legal = kLegal.at(trigger);
  if (const auto to = legal.find(state); to != legal.end()) {
    EXPECT_EQ(refusal, AxisRefusal::kNone);
    EXPECT_EQ(rig.machine.state(), to->second);
    EXPECT_GT(rig.channel.posted(), posted) << "the drive is told";
    rig.step();
    if (trigger == kEnable) {
      EXPECT_EQ(rig.machine.state(), kStandstill);
    }
    if (trigger == kReset) {
      EXPECT_EQ(rig.machine.state(), kDisabled);
    }
  } else {
    EXPECT_EQ(refusal, AxisRefusal::kWrongState);
    EXPECT_EQ(rig.machine.state(), state);
    EXPECT_EQ(rig.channel.posted(), posted) << "the drive is left alone";
  }
}

INSTANTIATE_TEST_SUITE_P(All, EveryStateAndCommand,
                         testing::Combine(testing::ValuesIn(kAxisStates), testing::ValuesIn(kAxisCommands)),
                         [](const auto& p) {
                           return std::string(to_string(std::get<0>(p.param))) + "_" +
                                  std::string(to_string(std::get<1>(p.param)));
                         });

TEST(AxisStates, TheDocumentationShowsTheTable) {
  std::stringstream text;
  text << std::ifstream(GANTRY_SOURCE_DIR "/docs/motion.md").rdbuf();
  EXPECT_NE(text.str().find("```mermaid\n" + axis_state_diagram() + "```"), std::string::npos)
      << "docs/motion.md must hold:\n"
      << axis_state_diagram();
}

}  // namespace
}  // namespace gantry
