#include <cmath>

#include "hal/modbus_servers.h"

namespace gantry {
namespace {

TEST(ModbusDriveConfigTest, MistakesAreRejectedByName) {
  SteadyClock clock;
  ModbusDriveConfig good;
  good.axis = "tilt";
  good.kind = AxisKind::kRotary;
  good.profile = "oriental_motor_az";
  good.host = "127.0.0.1";
  good.counts_per_axis_unit = 5729.6;
  EXPECT_NO_THROW(make_modbus_drive(good, nullptr, clock));
  for (auto break_it : {+[](ModbusDriveConfig& c) { c.profile = "acme"; },
                        +[](ModbusDriveConfig& c) { c.profile = "iai_robo_cylinder"; },  // Rotary.
                        +[](ModbusDriveConfig& c) { c.host = ""; },                      //
                        +[](ModbusDriveConfig& c) { c.port = 70'000; },                  //
                        +[](ModbusDriveConfig& c) { c.unit = 0; },                       //
                        +[](ModbusDriveConfig& c) { c.unit = 248; },                     //
                        +[](ModbusDriveConfig& c) { c.counts_per_axis_unit = 0; },       //
                        +[](ModbusDriveConfig& c) { c.response_timeout_s = 0; }}) {
    ModbusDriveConfig config = good;
    break_it(config);
    try {
      make_modbus_drive(config, nullptr, clock);
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("axis tilt"), std::string::npos);
    }
  }
}

TEST(ModbusDriveConfigTest, WhatTheRegistersCannotHoldIsRefusedBeforeItIsSent) {
  SteadyClock clock;
  const auto drive = iai_at(1, clock);  // Nobody listens there: an attempt to send would say so.
  for (const MoveCommand& command :
       {MoveCommand{3e7, 1, 1}, MoveCommand{1, 1e5, 1}, MoveCommand{1, 1, 1e8}, MoveCommand{1, 0, 1},
        MoveCommand{1, 1, -1}, MoveCommand{std::nan(""), 1, 1}}) {
    const auto moved = drive->start_move(command);
    ASSERT_FALSE(moved);
    EXPECT_EQ(moved.error().kind, FaultKind::kLimit) << moved.error().text();
  }
}

}  // namespace
}  // namespace gantry
