#include "joined_vertices.h"

#include <bit>
#include <cstdint>

#include "large_pages.h"

namespace gantry::internal {

std::vector<int> joined_by_position(const std::vector<Eigen::Vector3f>& vertices) {
  const size_t slots = std::bit_ceil(2 * vertices.size() + 1);
  LargeVector<int> table(slots, -1);
  std::vector<int> joined(vertices.size());
  for (size_t i = 0; i < vertices.size(); ++i) {
    uint64_t hash = 0;
    for (const float c : vertices[i])
      hash = (hash ^ std::bit_cast<uint32_t>(c + 0.0f)) * 0x9e3779b97f4a7c15u;  // -0 is 0
    size_t slot = (hash >> 20) & (slots - 1);
    while (table[slot] >= 0 && vertices[static_cast<size_t>(table[slot])] != vertices[i])
      slot = (slot + 1) & (slots - 1);
    if (table[slot] < 0) table[slot] = static_cast<int>(i);
    joined[i] = table[slot];
  }
  return joined;
}

}  // namespace gantry::internal
