#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gantry/hal/modbus_drives.h"
#include "gantry/hal/safety_inputs.h"

namespace gantry {

/// Safety inputs wired to a Modbus I/O module and read as discrete inputs: function 02 of the Modbus
/// Application Protocol V1.1b3 (6.2). All channels come from one request, so that both channels of an input
/// are of one instant, as far as the module samples them together.
struct ModbusSafetyInputsConfig {
  std::string host;  ///< Address or name.
  int port = 502;
  int unit = 1;                      ///< Modbus unit, 1 to 247.
  std::vector<int> channels;         ///< PDU addresses (from 0), in the order of the levels read.
  double response_timeout_s = 0.05;  ///< For one reading, reopening the connection included.
};

/// `bus` may be null: the module then has a connection of its own. Throws InputError when the configuration
/// cannot be right. Opens nothing yet: the first read() does; a lost connection is opened again by the next.
std::unique_ptr<SafetyInputs> make_modbus_safety_inputs(const ModbusSafetyInputsConfig& config,
                                                        std::shared_ptr<ModbusBus> bus);

}  // namespace gantry
