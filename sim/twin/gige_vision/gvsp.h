#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvcp.h"
#include "udp_socket.h"

namespace gantry::gige {

/// Pixels of the sensor that are sent.
struct Region {
  uint32_t x = 0;
  uint32_t y = 0;
  uint32_t width = 0;
  uint32_t height = 0;
};

struct ChunkLayout {
  bool active = false;  ///< Off: the payload is the bare image.
  bool frame_id = false;
  bool timestamp = false;
  bool exposure_time = false;

  /// Bytes of the payload that are not pixels.
  uint32_t overhead() const;
};

/// How packets of the stream channel are cut and where they go.
struct StreamFormat {
  Endpoint destination;         ///< Port 0: the channel is closed.
  uint32_t packet_size = 1500;  ///< With IP (20), UDP (8) and GVSP headers.
  uint64_t packet_delay_ns = 0;
  bool do_not_fragment = false;
  bool extended_ids = false;  ///< 64-bit block id, 32-bit packet id, 20-byte header.
  bool mark_resends = false;  ///< GEV_STATUS_PACKET_RESEND in resent packets (extended status codes of 1.1).

  bool open() const { return destination.port != 0 && destination.ip != 0; }
  uint32_t header_size() const { return extended_ids ? 20 : 8; }
  uint32_t payload_per_packet() const { return packet_size - 28 - header_size(); }
};

/// One block (frame) as it goes over the stream channel: packet 0 is the leader, the last one the trailer.
struct Block {
  StreamFormat format;
  uint64_t id = 0;
  std::vector<uint8_t> leader = {};
  std::vector<uint8_t> payload = {};
  std::vector<uint8_t> trailer = {};

  uint32_t packet_count() const;
  std::span<const uint8_t> content(uint32_t packet_id) const;
};

struct FrameFacts {
  uint64_t block_id = 0;
  uint64_t timestamp_ns = 0;
  double exposure_us = 0;
};

/// The GVSP header of one packet.
std::vector<uint8_t> gvsp_header(const Block& block, uint32_t packet_id, bool resent);

/// The answer to a request for a packet that is not in memory: a header without content.
std::vector<uint8_t> unavailable_packet(const StreamFormat& format, uint64_t block_id, uint32_t packet_id);

/// The test packet that SCPS's fire_test_packet asks for: exactly packet_size long on the wire.
std::vector<uint8_t> test_packet(const StreamFormat& format);

/// Codes `xyz` (sensor_width * sensor_height * 3, NaN where there is no point) as Coord3D_ABC32f with its
/// chunks. `buffer` is recycled for the payload.
Block encode_block(const std::vector<float>& xyz, uint32_t sensor_width,
                   const std::array<Scan3dCoordinate, 3>& coordinates, const Region& region,
                   const ChunkLayout& chunks, const StreamFormat& format, const FrameFacts& facts,
                   std::vector<uint8_t> buffer);

}  // namespace gantry::gige
