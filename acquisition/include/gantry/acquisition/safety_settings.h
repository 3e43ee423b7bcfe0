#pragma once

#include <string>

#include "gantry/acquisition/safety_chain.h"
#include "gantry/foundation/strict_yaml.h"

namespace gantry {

/// The I/O module that the inputs are wired to.
struct SafetyModuleSettings {
  std::string kind;  ///< "modbus" or "simulated" (contacts in this process).
  std::string host;
  int port = 502;
  int unit = 1;
  double response_timeout_s = 0.05;  ///< For one reading.
};

/// The `safety:` section of CELL.yaml.
struct CellSafety {
  SafetyModuleSettings module;
  SafetySettings chain;
  double poll_s = 0.02;  ///< How often the inputs are read.

  /// So long after the first reading every input that is closed counts as released.
  double settle_s() const;
};

/// Reads the section; the format is in docs/files.md. Throws InputError with file, line and key.
CellSafety read_safety(StrictYaml yaml);

}  // namespace gantry
