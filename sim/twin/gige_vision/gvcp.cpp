#include "gvcp.h"

#include "wire.h"

namespace gantry::gige {

std::optional<GvcpCommand> parse_gvcp(std::span<const uint8_t> datagram) {
  constexpr uint8_t kKey = 0x42;
  if (datagram.size() < kGvcpHeaderSize || datagram.size() > kGvcpHeaderSize + kGvcpMaxPayload ||
      datagram[0] != kKey) {
    return std::nullopt;
  }
  return GvcpCommand{.flags = datagram[1],
                     .command = get_u16(datagram, 2),
                     .length = get_u16(datagram, 4),
                     .request_id = get_u16(datagram, 6),
                     .payload = datagram.subspan(kGvcpHeaderSize)};
}

std::vector<uint8_t> make_ack(const GvcpCommand& command, GvcpStatus status,
                              std::span<const uint8_t> payload) {
  std::vector<uint8_t> ack;
  ack.reserve(kGvcpHeaderSize + payload.size());
  append_u16(ack, static_cast<uint16_t>(status));
  append_u16(ack, static_cast<uint16_t>(command.command + 1));
  append_u16(ack, static_cast<uint16_t>(payload.size()));
  append_u16(ack, command.request_id);
  ack.insert(ack.end(), payload.begin(), payload.end());
  return ack;
}

}  // namespace gantry::gige
