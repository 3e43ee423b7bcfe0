#pragma once

#include <cstdint>
#ifdef __SSE__
#include <xmmintrin.h>
#endif

/// Eight floats at a time, by the vector extensions of GCC and Clang: two SSE registers, or one of AVX in
/// functions marked GANTRY_FOR_EACH_CPU, of which the loader picks the version that fits the machine. No
/// version fuses multiplications and additions, so all give the same bits.
namespace gantry::internal {

// All that takes lanes is inlined: how they would be handed over does not matter.
#pragma GCC diagnostic ignored "-Wpsabi"

constexpr int kLanes = 8;
// The alignment is said: without AVX it would be 16 where memory is laid out, and 32 where AVX reads it.
using Lanes = float __attribute__((vector_size(32), aligned(32)));
using LaneMask = int32_t __attribute__((vector_size(32), aligned(32)));

#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
// Not under sanitizers: the choice runs before their start-up has.
#define GANTRY_FOR_EACH_CPU __attribute__((target_clones("avx2", "default")))
#else
#define GANTRY_FOR_EACH_CPU
#endif
#define GANTRY_INLINE [[gnu::always_inline]] inline

struct Lanes3 {
  Lanes x, y, z;
};

GANTRY_INLINE void set_lane(Lanes3& lanes, int lane, float x, float y, float z) {
  lanes.x[lane] = x;
  lanes.y[lane] = y;
  lanes.z[lane] = z;
}
GANTRY_INLINE Lanes3 subtract(const Lanes3& a, const Lanes3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
GANTRY_INLINE Lanes dot(const Lanes3& a, const Lanes3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
GANTRY_INLINE Lanes3 cross(const Lanes3& a, const Lanes3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
GANTRY_INLINE Lanes minimum(const Lanes& a, const Lanes& b) {
  return a < b ? a : b;
}
GANTRY_INLINE Lanes maximum(const Lanes& a, const Lanes& b) {
  return a > b ? a : b;
}

/// One bit per lane that is true.
GANTRY_INLINE unsigned bits_of(const LaneMask& mask) {
#ifdef __SSE__
  using Half = float __attribute__((vector_size(16)));
  Half halves[2];
  __builtin_memcpy(halves, &mask, sizeof mask);
  return static_cast<unsigned>(_mm_movemask_ps(halves[0])) | static_cast<unsigned>(_mm_movemask_ps(halves[1]))
                                                                 << 4;
#else
  unsigned bits = 0;
  for (int k = 0; k < kLanes; ++k) bits |= static_cast<unsigned>(mask[k] & 1) << k;
  return bits;
#endif
}

}  // namespace gantry::internal
