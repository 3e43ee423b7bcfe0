#include "register_memory.h"

#include <algorithm>
#include <bit>

#include "wire.h"

namespace gantry::gige {

void RegisterMemory::add_block(uint32_t address, uint32_t size) {
  blocks_[address].resize(size);
}

std::optional<RegisterMemory::Place> RegisterMemory::locate(uint32_t address, size_t size) const {
  const auto next = blocks_.upper_bound(address);
  if (next == blocks_.begin()) return std::nullopt;
  const auto& [first, bytes] = *std::prev(next);
  const size_t offset = address - first;
  if (offset > bytes.size() || size > bytes.size() - offset) return std::nullopt;
  return Place{first, offset};
}

GvcpStatus RegisterMemory::read(uint32_t address, std::span<uint8_t> out) const {
  if (address % 4 != 0 || out.size() % 4 != 0) return GvcpStatus::kBadAlignment;
  const auto place = locate(address, out.size());
  if (!place) return GvcpStatus::kInvalidAddress;
  const auto begin = blocks_.at(place->block).begin() + static_cast<std::ptrdiff_t>(place->offset);
  std::copy_n(begin, out.size(), out.begin());
  return GvcpStatus::kSuccess;
}

GvcpStatus RegisterMemory::check_write(uint32_t address) const {
  if (address % 4 != 0) return GvcpStatus::kBadAlignment;
  if (!locate(address, 4)) return GvcpStatus::kInvalidAddress;
  return writable_.contains(address) ? GvcpStatus::kSuccess : GvcpStatus::kWriteProtect;
}

uint32_t RegisterMemory::u32(uint32_t address) const {
  const Place place = locate(address, 4).value();
  return get_u32(blocks_.at(place.block), place.offset);
}

float RegisterMemory::f32(uint32_t address) const {
  return std::bit_cast<float>(u32(address));
}

void RegisterMemory::set_u32(uint32_t address, uint32_t value) {
  std::vector<uint8_t> bytes;
  append_u32(bytes, value);
  set_bytes(address, bytes);
}

void RegisterMemory::set_u64(uint32_t address, uint64_t value) {
  std::vector<uint8_t> bytes;
  append_u64(bytes, value);
  set_bytes(address, bytes);
}

void RegisterMemory::set_f32(uint32_t address, float value) {
  set_u32(address, std::bit_cast<uint32_t>(value));
}

void RegisterMemory::set_bytes(uint32_t address, std::span<const uint8_t> bytes) {
  const Place place = locate(address, bytes.size()).value();
  const auto begin = blocks_.at(place.block).begin() + static_cast<std::ptrdiff_t>(place.offset);
  std::copy(bytes.begin(), bytes.end(), begin);
}

void RegisterMemory::set_text(uint32_t address, const std::string& text, uint32_t size) {
  std::vector<uint8_t> bytes(text.begin(), text.end());
  bytes.resize(size);
  set_bytes(address, bytes);
}

}  // namespace gantry::gige
