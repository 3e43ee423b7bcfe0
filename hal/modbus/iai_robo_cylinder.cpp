#include "modbus/iai_robo_cylinder.h"

#include <cstdlib>

#include "modbus/axis_counts.h"
#include "modbus/word_codec.h"

namespace gantry {
namespace {

// Coils, function 05 (IAI 5.4).
constexpr uint16_t kServoOn = 0x0403;
constexpr uint16_t kAlarmReset = 0x0407;
constexpr uint16_t kHomeReturn = 0x040B;
constexpr uint16_t kModbusCommands = 0x0427;
constexpr uint16_t kDecelerationStop = 0x042C;

// Status block, function 03 (IAI 4.3.2): ten registers, read at once so that they belong together.
constexpr uint16_t kStatusBlock = 0x9000;
constexpr uint16_t kStatusWords = 10;
constexpr size_t kPosition = 0x9000 - kStatusBlock;
constexpr size_t kAlarmCode = 0x9002 - kStatusBlock;
constexpr size_t kDeviceStatus = 0x9005 - kStatusBlock;
constexpr size_t kExtendedStatus = 0x9007 - kStatusBlock;

constexpr uint16_t kEmergencyStop = 1u << 15;
constexpr uint16_t kServoIsOn = 1u << 12;
constexpr uint16_t kMajorAlarm = 1u << 10;
constexpr uint16_t kPaused = 1u << 5;
constexpr uint16_t kHomed = 1u << 4;
constexpr uint16_t kPositioningDone = 1u << 3;

constexpr uint16_t kExtendedHoming = 1u << 11;
constexpr uint16_t kExtendedMoving = 1u << 5;

// Numerical movement, function 10 (IAI 5.6.1): writing this block starts the move.
constexpr uint16_t kMoveBlock = 0x9900;
constexpr double kSpeedCountsPerMm_s = 100;           // 0.01 mm/s
constexpr double kAccelerationCount_mm_s2 = 98.0665;  // 0.01 G
constexpr int32_t kMaxSpeedCounts = 999'999;
constexpr int32_t kMaxAccelerationCounts = 0xFFFF;

}  // namespace

IaiRoboCylinderDrive::IaiRoboCylinderDrive(ModbusUnit unit, double in_position_mm, Clock& clock)
    : unit_(std::move(unit)),
      in_position_counts_(to_rate_counts(in_position_mm, kCountsPerMm, kMaxSpeedCounts).value_or(1)),
      clock_(clock) {}

void IaiRoboCylinderDrive::forget_motion() {
  target_counts_.reset();
  start_.forget();
}

Result<void> IaiRoboCylinderDrive::connect() {
  if (auto block = unit_.first_read(kStatusBlock, kStatusWords); !block)
    return tl::make_unexpected(block.error());
  return {};
}

Result<DriveStatus> IaiRoboCylinderDrive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchange: never younger than it claims.
  const auto block = unit_.read(kStatusBlock, kStatusWords);
  if (!block) return tl::make_unexpected(block.error());
  const int32_t position = word_pair(*block, kPosition);
  const uint16_t device = (*block)[kDeviceStatus];
  const uint16_t extended = (*block)[kExtendedStatus];

  status.position = position / kCountsPerMm;
  status.servo_on = (device & kServoIsOn) != 0;
  status.homed = (device & kHomed) != 0;
  status.emergency_stop = ((device | extended) & kEmergencyStop) != 0;
  if (device & kMajorAlarm) status.alarm = (*block)[kAlarmCode];

  const bool under_way = (extended & (kExtendedMoving | kExtendedHoming)) != 0;
  const bool positioned = (device & kPositioningDone) != 0;
  const bool started = under_way || (target_counts_ ? !positioned : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  // PEND alone comes on before the motion has ended, and belongs to any move, not just to ours.
  status.in_position = target_counts_ && positioned && !status.moving &&
                       std::abs(int64_t{position} - *target_counts_) <= in_position_counts_;
  return status;
}

Result<void> IaiRoboCylinderDrive::set_servo(bool on) {
  forget_motion();
  if (on) {
    // Without it the drive takes its commands from its I/O plug and ignores the coils below.
    if (auto done = unit_.write_coil(kModbusCommands, true); !done) return done;
  }
  return unit_.write_coil(kServoOn, on);
}

// A paused drive keeps a command and runs it when somebody ends the pause: no motion by surprise.
Result<int32_t> IaiRoboCylinderDrive::position_unless_paused() const {
  const auto block = unit_.read(kStatusBlock, kStatusWords);
  if (!block) return tl::make_unexpected(block.error());
  if ((*block)[kDeviceStatus] & kPaused)
    return unit_.refused("motion refused: the drive is paused (coil 040Ah); end the pause where it was set");
  return word_pair(*block, kPosition);
}

Result<void> IaiRoboCylinderDrive::start_homing() {
  if (auto position = position_unless_paused(); !position) return tl::make_unexpected(position.error());
  forget_motion();
  if (auto done = unit_.write_coil(kHomeReturn, false); !done) return done;
  if (auto done = unit_.write_coil(kHomeReturn, true); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> IaiRoboCylinderDrive::start_move(const MoveCommand& command) {
  const auto target = to_counts(command.target, kCountsPerMm);
  const auto speed = to_rate_counts(command.speed, kSpeedCountsPerMm_s, kMaxSpeedCounts);
  const auto acceleration =
      to_rate_counts(command.acceleration, 1.0 / kAccelerationCount_mm_s2, kMaxAccelerationCounts);
  if (!target || !speed || !acceleration)
    return fault(FaultKind::kLimit, info().text(),
                 "move refused: target, speed or acceleration does not fit into the drive's registers");

  const auto position = position_unless_paused();
  if (!position) return tl::make_unexpected(position.error());
  forget_motion();
  std::vector<uint16_t> move;
  append_words(move, *target);                           // 9900 target
  append_words(move, in_position_counts_);               // 9902 positioning band
  append_words(move, *speed);                            // 9904
  move.push_back(static_cast<uint16_t>(*acceleration));  // 9906
  move.push_back(0);                                     // 9907 push current: not a push move
  move.push_back(0);                                     // 9908 flags: absolute
  if (auto done = unit_.write(kMoveBlock, move); !done) return done;
  target_counts_ = *target;
  // Where it already stands no motion will show.
  if (*target != *position) start_.commanded(clock_.now_s());
  return {};
}

Result<void> IaiRoboCylinderDrive::halt() {
  forget_motion();
  return unit_.write_coil(kDecelerationStop, true);
}

Result<void> IaiRoboCylinderDrive::reset_alarm() {
  forget_motion();
  if (auto done = unit_.write_coil(kAlarmReset, false); !done) return done;
  if (auto done = unit_.write_coil(kAlarmReset, true); !done) return done;
  return unit_.write_coil(kAlarmReset, false);
}

}  // namespace gantry
