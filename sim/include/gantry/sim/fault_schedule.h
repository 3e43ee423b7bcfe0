#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gantry {

/// What a fault is done to.
enum class FaultDevice : uint8_t { kAxis, kBus, kSafety, kCamera };

/// Every fault that a schedule can play, of mechanics, drives, wires, safety inputs and the camera.
enum class FaultMode : uint8_t {
  // An axis: its mechanics (StageFault) ...
  kStuck,
  kRunaway,
  kSlip,  ///< At once, and not reversible: homing finds the truth again.
  kDeadHomeSwitch,
  kLimitBounce,
  // ... its drive ...
  kAlarm,          ///< Its cause stays as long as the fault; the alarm itself until it is reset.
  kEmergencyStop,  ///< The drive's own input.
  kPowerLoss,      ///< Silent meanwhile; afterwards without torque and without a home position.
  kSilent,         ///< A dead slave; also the camera.
  // A bus: what WireFaults does to its exchanges, and its plug.
  kLoseRequest,
  kDropReply,
  kDelayReply,
  kTruncateReply,
  kCorruptReply,
  kDuplicateReply,
  kException,
  kDisconnect,
  // A safety device.
  kPress,
  kWireBreak,
  kStickContact,
  // The camera.
  kDataLoss  ///< Packets are lost for good: no scan is complete.
};

/// The word of a mode in FAULTS.yaml: "stuck", "drop_reply", ...
std::string_view to_string(FaultMode mode);
/// "axis", "bus", "safety", "camera".
std::string_view to_string(FaultDevice device);

/// The facts of one mode.
struct FaultModeInfo {
  FaultDevice device;
  FaultMode mode;
  std::string_view word;
  bool lasts;  ///< It has a duration, after which it is reversed.
};
/// One for each pair of device and mode that there is.
const std::vector<FaultModeInfo>& fault_modes();

/// Something that happens in the cell and that a fault can wait for.
enum class FaultEvent : uint8_t { kMotion, kExposure };

/// One fault. Fields that its mode does not use keep their defaults.
struct FaultEntry {
  /// Of the clock that starts with the schedule; with an event, from the event on.
  double at_s = 0;
  std::optional<FaultEvent> event;  ///< Begins at its `event_count`-th occurrence instead.
  int event_count = 1;
  double for_s = 0;  ///< Reversed after this time; 0 for kSlip.
  FaultDevice device = FaultDevice::kAxis;
  std::string name;  ///< Of the axis, bus or safety device; empty for the camera.
  FaultMode mode = FaultMode::kStuck;

  double probability = 1;  ///< Of each exchange (kLoseRequest to kException).
  double delay_s = 0.5;    ///< kDelayReply.
  bool upwards = true;     ///< kRunaway.
  double distance = 0;     ///< kSlip: mm or rad.
  double lag_s = 0;        ///< kPress: how much later the second contact opens.
  int contact = 0;         ///< kWireBreak, kStickContact: 0 or 1.
  int code = 1;            ///< kAlarm.

  bool operator==(const FaultEntry&) const = default;
  /// "axis linear: stuck", for a person.
  std::string text() const;
};

struct FaultSchedule {
  uint64_t seed = 1;  ///< Of every random number that playing it needs.
  std::vector<FaultEntry> entries;
  bool operator==(const FaultSchedule&) const = default;
};

/// What a schedule may name.
struct FaultTargetNames {
  struct Axis {
    std::string name;
    bool rotary = false;
  };
  struct Safety {
    std::string name;
    int contacts = 1;
  };
  std::vector<Axis> axes;
  std::vector<std::string> buses;
  std::vector<Safety> safety;
};

/// Reads FAULTS.yaml (docs/files.md). Throws InputError with file and line for anything that is missing,
/// unknown, out of range or names what the cell does not have.
FaultSchedule read_fault_schedule(const std::filesystem::path& path, const FaultTargetNames& names);

/// The same schedule as text that is read back without a difference, numbers included. `comment` may be
/// empty; each of its lines becomes a comment at the top.
std::string fault_schedule_text(const FaultSchedule& schedule, const FaultTargetNames& names,
                                const std::string& comment);

}  // namespace gantry
