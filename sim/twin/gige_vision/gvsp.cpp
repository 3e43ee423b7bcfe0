#include "gvsp.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "device_registers.h"
#include "wire.h"

namespace gantry::gige {
namespace {

static_assert(std::endian::native == std::endian::little, "pixels go out in memory order: little-endian");

enum PacketFormat : uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

constexpr uint16_t kPayloadImage = 0x0001;
constexpr uint16_t kExtendedChunk = 0x4000;

constexpr size_t kBytesPerPixel = 3 * sizeof(float);
/// A chunk is its data, then its id and length.
constexpr uint32_t kChunkTag = 8;
constexpr uint32_t kChunkData = 8;  ///< Every chunk but the image is one 64-bit value.

std::vector<uint8_t> header_bytes(const StreamFormat& format, GvcpStatus status, uint64_t block_id,
                                  PacketFormat packet_format, uint32_t packet_id, bool resent) {
  std::vector<uint8_t> bytes;
  bytes.reserve(format.header_size());
  append_u16(bytes, static_cast<uint16_t>(status));
  if (format.extended_ids) {
    append_u16(bytes, resent ? 0x0001 : 0x0000);  // Flag: bit 15 marks a retransmission.
    append_u32(bytes, 0x80000000u | static_cast<uint32_t>(packet_format) << 24);
    append_u64(bytes, block_id);
    append_u32(bytes, packet_id);
  } else {
    append_u16(bytes, static_cast<uint16_t>(block_id));
    append_u32(bytes, static_cast<uint32_t>(packet_format) << 24 | (packet_id & 0x00FFFFFFu));
  }
  return bytes;
}

/// The pixels of one row; returns one past the last byte written.
uint8_t* encode_row(const float* xyz, uint32_t width, const std::array<Scan3dCoordinate, 3>& coordinates,
                    uint8_t* out) {
  for (uint32_t column = 0; column < width; ++column, xyz += 3, out += kBytesPerPixel) {
    const bool valid = std::isfinite(xyz[0]) && std::isfinite(xyz[1]) && std::isfinite(xyz[2]);
    std::array<float, 3> raw;
    for (size_t i = 0; i < 3; ++i) {
      const Scan3dCoordinate& c = coordinates[i];
      raw[i] = valid ? (xyz[i] - c.offset_mm) / c.scale : c.invalid_value;
    }
    std::memcpy(out, raw.data(), kBytesPerPixel);
  }
  return out;
}

void append_tag(std::vector<uint8_t>& payload, uint32_t id, uint32_t length) {
  append_u32(payload, id);
  append_u32(payload, length);
}

void append_chunk(std::vector<uint8_t>& payload, uint32_t id, uint64_t value) {
  append_u64(payload, value);
  append_tag(payload, id, kChunkData);
}

}  // namespace

uint32_t ChunkLayout::overhead() const {
  if (!active) return 0;
  const uint32_t count = frame_id + timestamp + exposure_time;
  return kChunkTag + count * (kChunkData + kChunkTag);
}

uint32_t Block::packet_count() const {
  const size_t per_packet = format.payload_per_packet();
  return static_cast<uint32_t>((payload.size() + per_packet - 1) / per_packet) + 2;
}

std::span<const uint8_t> Block::content(uint32_t packet_id) const {
  if (packet_id == 0) return leader;
  if (packet_id + 1 == packet_count()) return trailer;
  const size_t per_packet = format.payload_per_packet();
  const size_t begin = (packet_id - 1) * per_packet;
  return std::span(payload).subspan(begin, std::min(per_packet, payload.size() - begin));
}

std::vector<uint8_t> gvsp_header(const Block& block, uint32_t packet_id, bool resent) {
  const PacketFormat packet_format =
      packet_id == 0 ? kLeader : (packet_id + 1 == block.packet_count() ? kTrailer : kPayload);
  const auto status = resent && block.format.mark_resends ? GvcpStatus::kPacketResend : GvcpStatus::kSuccess;
  return header_bytes(block.format, status, block.id, packet_format, packet_id, resent);
}

std::vector<uint8_t> unavailable_packet(const StreamFormat& format, uint64_t block_id, uint32_t packet_id) {
  return header_bytes(format, GvcpStatus::kPacketUnavailable, block_id, kPayload, packet_id, false);
}

std::vector<uint8_t> test_packet(const StreamFormat& format) {
  std::vector<uint8_t> bytes = header_bytes(format, GvcpStatus::kSuccess, 0, kPayload, 0, false);
  bytes.resize(format.header_size() + format.payload_per_packet());
  return bytes;
}

Block encode_block(const std::vector<float>& xyz, uint32_t sensor_width,
                   const std::array<Scan3dCoordinate, 3>& coordinates, const Region& region,
                   const ChunkLayout& chunks, const StreamFormat& format, const FrameFacts& facts,
                   std::vector<uint8_t> buffer) {
  Block block{.format = format, .id = facts.block_id, .payload = std::move(buffer)};
  const size_t image_size = size_t{region.width} * region.height * kBytesPerPixel;
  block.payload.reserve(image_size + chunks.overhead());
  block.payload.resize(image_size);
  uint8_t* out = block.payload.data();
  for (uint32_t row = region.y; row < region.y + region.height; ++row) {
    out = encode_row(&xyz[(size_t{row} * sensor_width + region.x) * 3], region.width, coordinates, out);
  }
  if (chunks.active) {
    append_tag(block.payload, kChunkImage, static_cast<uint32_t>(image_size));
    if (chunks.frame_id) append_chunk(block.payload, kChunkFrameId, facts.block_id);
    if (chunks.timestamp) append_chunk(block.payload, kChunkTimestamp, facts.timestamp_ns);
    if (chunks.exposure_time) {
      append_chunk(block.payload, kChunkExposureTime, std::bit_cast<uint64_t>(facts.exposure_us));
    }
  }

  const uint16_t payload_type = chunks.active ? kPayloadImage | kExtendedChunk : kPayloadImage;
  append_u16(block.leader, 0);  // Field id and count: progressive scan.
  append_u16(block.leader, payload_type);
  append_u64(block.leader, facts.timestamp_ns);
  append_u32(block.leader, kCoord3dAbc32f);
  append_u32(block.leader, region.width);
  append_u32(block.leader, region.height);
  append_u32(block.leader, region.x);
  append_u32(block.leader, region.y);
  append_u16(block.leader, 0);  // Padding of lines and of the image.
  append_u16(block.leader, 0);

  append_u16(block.trailer, 0);
  append_u16(block.trailer, payload_type);
  append_u32(block.trailer, region.height);
  if (chunks.active) {
    append_u32(block.trailer, static_cast<uint32_t>(block.payload.size()));
    // The layout's id must change with the layout.
    append_u32(block.trailer, 1u + chunks.frame_id + 2u * chunks.timestamp + 4u * chunks.exposure_time);
  }
  return block;
}

}  // namespace gantry::gige
