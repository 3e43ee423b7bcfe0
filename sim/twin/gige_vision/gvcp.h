#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace gantry::gige {

inline constexpr uint16_t kGvcpPort = 3956;
/// A GVCP message fits in 576 bytes of IP: 20 (IP) + 8 (UDP) + 8 (header) + at most 540.
inline constexpr size_t kGvcpHeaderSize = 8;
inline constexpr size_t kGvcpMaxPayload = 540;

enum class GvcpStatus : uint16_t {
  kSuccess = 0x0000,
  kPacketResend = 0x0100,  ///< In GVSP only: this packet is a retransmission.
  kNotImplemented = 0x8001,
  kInvalidParameter = 0x8002,
  kInvalidAddress = 0x8003,
  kWriteProtect = 0x8004,
  kBadAlignment = 0x8005,
  kAccessDenied = 0x8006,
  kBusy = 0x8007,
  kPacketUnavailable = 0x800C,
  kInvalidHeader = 0x800E,
};

/// Command values; the acknowledge is the command + 1.
inline constexpr uint16_t kDiscoveryCmd = 0x0002;
inline constexpr uint16_t kPacketResendCmd = 0x0040;
inline constexpr uint16_t kReadRegCmd = 0x0080;
inline constexpr uint16_t kWriteRegCmd = 0x0082;
inline constexpr uint16_t kReadMemCmd = 0x0084;
inline constexpr uint16_t kWriteMemCmd = 0x0086;

struct GvcpCommand {
  uint8_t flags = 0;
  uint16_t command = 0;
  uint16_t length = 0;  ///< As the header claims; payload.size() is what arrived.
  uint16_t request_id = 0;
  std::span<const uint8_t> payload;

  bool ack_required() const { return flags & 0x01; }
  bool extended_ids() const { return flags & 0x10; }  ///< PACKETRESEND_CMD: 64-bit block id follows.
  bool header_consistent() const { return length == payload.size() && request_id != 0; }
};

/// Nothing if the datagram is no GVCP command at all (too short, too long or without the key 0x42); the
/// standard has such a datagram discarded without an answer.
std::optional<GvcpCommand> parse_gvcp(std::span<const uint8_t> datagram);

std::vector<uint8_t> make_ack(const GvcpCommand& command, GvcpStatus status,
                              std::span<const uint8_t> payload = {});

}  // namespace gantry::gige
