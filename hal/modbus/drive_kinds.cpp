#include "modbus/drive_profile.h"

namespace gantry {
namespace {

constexpr auto kOptional = ProfileName::Need::kOptional;

/// What every kind may have besides its own.
void add_common(DriveKind& kind) {
  kind.registers.insert(kind.registers.end(), {{"position"},
                                               {"alarm_code"},
                                               {"following_error", kOptional},
                                               {"digital_inputs", kOptional},
                                               {"communication_timeout", kOptional}});
  kind.bits.insert(
      kind.bits.end(),
      {{"homed"}, {"emergency_stop", kOptional}, {"lower_limit", kOptional}, {"upper_limit", kOptional}});
  kind.numbers.push_back({"communication_timeout_unit_s", kOptional});
  kind.in_status.insert(kind.in_status.end(), {"position", "following_error"});
}

DriveKind numerical_move() {
  return {.kind = "numerical_move",
          .registers = {{"device_status"},
                        {"extended_status"},
                        {"target"},
                        {"band"},
                        {"speed"},
                        {"acceleration"},
                        {"push_current"},
                        {"flags"}},
          .bits = {{"emergency_stop_input", kOptional},
                   {"servo_on"},
                   {"alarm"},
                   {"paused", kOptional},
                   {"in_position"},
                   {"homing"},
                   {"moving"}},
          .coils = {{"servo_on"}, {"alarm_reset"}, {"home"}, {"enable_commands", kOptional}, {"stop"}},
          .numbers = {{"counts_per_mm"},
                      {"speed_unit_mm_s"},
                      {"acceleration_unit_mm_s2"},
                      {"max_speed"},
                      {"max_acceleration"}},
          .block = {"target", "band", "speed", "acceleration", "push_current", "flags"},
          .in_status = {}};
}

DriveKind direct_data() {
  return {.kind = "direct_data",
          .registers = {{"input"},
                        {"output"},
                        {"command_position"},
                        {"data_number"},
                        {"operation_type"},
                        {"target"},
                        {"speed"},
                        {"starting_rate"},
                        {"stopping_rate"},
                        {"current"},
                        {"trigger"}},
          .bits = {{"return_to_home"},
                   {"stop"},
                   {"free"},
                   {"alarm_reset"},
                   {"ready"},
                   {"alarm"},
                   {"moving"},
                   {"in_position"}},
          .coils = {},
          .numbers = {{"emergency_stop_alarm"}, {"max_speed"}, {"max_rate"}},
          .block = {"data_number", "operation_type", "target", "speed", "starting_rate", "stopping_rate",
                    "current", "trigger"},
          .in_status = {"input", "output", "command_position"}};
}

DriveKind pr_path() {
  return {.kind = "pr_path",
          .registers = {{"status"},
                        {"command_position", kOptional},
                        {"pulses_per_revolution", kOptional},
                        {"enable"},
                        {"control"},
                        {"trigger"},
                        {"path_mode"},
                        {"path_position"},
                        {"path_speed"},
                        {"path_acceleration"},
                        {"path_deceleration"},
                        {"path_delay"},
                        {"path_trigger"}},
          .bits = {{"fault"}, {"enabled"}, {"running"}, {"path_done"}},
          .coils = {},
          .numbers = {{"run_trigger"},
                      {"home_trigger"},
                      {"stop_trigger"},
                      {"reset_command"},
                      {"counts_per_motor_revolution"},
                      {"max_speed_rpm"},
                      {"max_ramp_ms"}},
          .block = {"path_mode", "path_position", "path_speed", "path_acceleration", "path_deceleration",
                    "path_delay", "path_trigger"},
          .in_status = {"command_position"}};
}

DriveKind cia402() {
  return {.kind = "cia402",
          .registers = {{"control_word"},
                        {"status_word"},
                        {"mode"},
                        {"quick_stop_option", kOptional},
                        {"velocity"},
                        {"target"},
                        {"speed"},
                        {"acceleration"},
                        {"deceleration"}},
          .bits = {},
          .coils = {},
          .numbers = {{"speed_per_count_s"}, {"acceleration_per_count_s2"}, {"standstill_speed"}},
          .block = {},
          .in_status = {"status_word", "velocity"}};
}

}  // namespace

const std::vector<DriveKind>& drive_kinds() {
  static const std::vector<DriveKind> kinds = [] {
    std::vector<DriveKind> all{numerical_move(), direct_data(), pr_path(), cia402()};
    for (DriveKind& kind : all) add_common(kind);
    return all;
  }();
  return kinds;
}

}  // namespace gantry
