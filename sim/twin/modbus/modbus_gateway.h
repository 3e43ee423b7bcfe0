#pragma once

#include <modbus.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>

#include "twin_drive.h"

namespace gantry {

using TwinDrives = std::map<int, std::unique_ptr<TwinDrive>>;  ///< By Modbus unit.

/// What the bytes received so far on a connection begin with.
struct ModbusFrame {
  enum class State { kIncomplete, kComplete, kNotModbus };
  State state = State::kIncomplete;
  size_t length = 0;  ///< Of the whole frame, when complete.
};

/// Finds the first frame by the MBAP header's own length field. modbus_receive() is not used for this: it
/// ignores that field, so that an unknown function desynchronises the stream, and it blocks every client on
/// half a frame.
ModbusFrame first_modbus_frame(std::span<const uint8_t> received);

/// Lets the addressed drive act on one complete frame, and sends its reply or exception through `context`'s
/// socket. False when the reply could not be sent.
bool answer_modbus_request(modbus_t* context, std::span<const uint8_t> frame, TwinDrives& drives,
                           double now_s);

}  // namespace gantry
