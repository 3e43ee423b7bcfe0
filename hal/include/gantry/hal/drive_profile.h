#pragma once

#include <string>
#include <vector>

#include "gantry/hal/drive.h"

namespace gantry {

/// What a cell must know of a drive profile before it makes a drive of it. A profile is a YAML file: which
/// kind of drive it is (the code) and where that drive keeps what (the data); docs/modbus-drives.md documents
/// it.
struct DriveProfileFacts {
  std::string name;                     ///< As asked for.
  std::string model;                    ///< "Kinco FD".
  std::string kind;                     ///< "cia402".
  bool linear = false, rotary = false;  ///< What it may move.
  /// The drive counts mm whatever its mechanics; otherwise the cell says how many counts a mm or a turn has.
  bool counts_fixed = false;
  bool counts_motor_revolutions = false;  ///< Its speeds are rpm of the motor.
};

/// `profile` is the name of a shipped profile or the path of a file (it contains a slash or ends in .yaml).
/// Throws InputError naming file, line and key, or listing the shipped ones where there is no such name.
DriveProfileFacts drive_profile_facts(const std::string& profile);

/// Names of the profiles that are compiled in, sorted.
std::vector<std::string> shipped_drive_profiles();

}  // namespace gantry
