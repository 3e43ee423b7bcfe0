#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "modbus/modbus_pdu.h"

namespace gantry {

/// The checksum of Modbus over Serial Line V1.02, section 6.2.2; travels low byte first.
uint16_t rtu_crc(std::span<const uint8_t> bytes);

/// Unit, PDU, checksum.
modbus_pdu::Bytes rtu_frame(int unit, std::span<const uint8_t> pdu);

/// What the bytes received since the line was last quiet begin with, seen by a client.
struct RtuAnswer {
  enum class State {
    kIncomplete,
    kComplete,
    kDamaged  ///< Checksum or length wrong, or no function of ours: only silence finds the next frame.
  };
  State state = State::kIncomplete;
  size_t length = 0;  ///< Of the whole frame, when complete.
};

/// Serial lines mark the end of a frame by silence, which buffers and USB adapters stretch and swallow;
/// so its length is taken from function and byte count, and confirmed by the checksum.
RtuAnswer first_rtu_answer(std::span<const uint8_t> received);

}  // namespace gantry
