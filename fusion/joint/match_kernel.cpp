#include "joint/match_kernel.h"

#include <cmath>

#include "range_image/simd.h"

namespace gantry::internal {
namespace {

using Setup = MatchKernel;

struct Unpacked {
  float x, y, z;
};

/// unpack_normal() without branches, of components already converted to float.
inline __attribute__((always_inline)) Unpacked unpack(float a, float b) {
  const float x0 = a * (1.0f / 32767.0f), y0 = b * (1.0f / 32767.0f);
  const float z = 1.0f - std::fabs(x0) - std::fabs(y0);
  const float fold = z < 0 ? -z : 0.0f;
  const float x = x0 - (x0 >= 0 ? fold : -fold), y = y0 - (y0 >= 0 ? fold : -fold);
  const float by = 1.0f / std::sqrt(x * x + y * y + z * z);
  return {x * by, y * by, z * by};
}

GANTRY_MULTIVERSION void rays_of(const Setup& s, MatchKernel::Pixels& in) {
  for (int k = 0; k < in.count; ++k) {
    in.u[k] = s.to_ray[0] + s.to_ray[1] * in.column[k] + s.to_ray[2] * in.row[k];
    in.v[k] = s.to_ray[3] + s.to_ray[4] * in.column[k] + s.to_ray[5] * in.row[k];
  }
}

GANTRY_MULTIVERSION void transform(const Setup& s, const MatchKernel::Pixels& in,
                                   MatchKernel::Falls& __restrict out) {
  const float central = s.source_central ? 1.0f : 0.0f;
  const float* __restrict r = s.rotation;
  const float t0 = s.shift[0], t1 = s.shift[1], t2 = s.shift[2];
  for (int k = 0; k < in.count; ++k) {
    const float depth = central != 0 ? 1.0f / in.w[k] : 1.0f;
    const float x = in.u[k] * depth, y = in.v[k] * depth, z = central != 0 ? depth : in.w[k];
    out.px[k] = r[0] * x + r[1] * y + r[2] * z + t0;
    out.py[k] = r[3] * x + r[4] * y + r[5] * z + t1;
    out.pz[k] = r[6] * x + r[7] * y + r[8] * z + t2;
    const Unpacked n = unpack(in.a[k], in.b[k]);
    out.nx[k] = r[0] * n.x + r[1] * n.y + r[2] * n.z;
    out.ny[k] = r[3] * n.x + r[4] * n.y + r[5] * n.z;
    out.nz[k] = r[6] * n.x + r[7] * n.y + r[8] * n.z;
  }
}

GANTRY_MULTIVERSION void look(const Setup& s, int count, MatchKernel::Falls& __restrict f) {
  if (s.target_central) {
    for (int k = 0; k < count; ++k) {
      const float by_z = 1.0f / (f.pz[k] > 1 ? f.pz[k] : 1.0f);
      f.w[k] = by_z;
      f.u[k] = f.px[k] * by_z;
      f.v[k] = f.py[k] * by_z;
      const float towards = f.nx[k] * f.px[k] + f.ny[k] * f.py[k] + f.nz[k] * f.pz[k];
      f.facing[k] = (f.pz[k] > 1) & (towards < 0) ? 1.0f : 0.0f;
    }
  } else {
    for (int k = 0; k < count; ++k) {
      f.w[k] = f.pz[k];
      f.u[k] = f.px[k];
      f.v[k] = f.py[k];
      f.facing[k] = f.nz[k] < 0 ? 1.0f : 0.0f;
    }
  }
  for (int k = 0; k < count; ++k) {
    f.column[k] = s.to_pixel[0] + s.to_pixel[1] * f.u[k] + s.to_pixel[2] * f.v[k];
    f.row[k] = s.to_pixel[3] + s.to_pixel[4] * f.u[k] + s.to_pixel[5] * f.v[k];
  }
}

/// What the sums are made of, match by match; gated ones have weight 0.
struct Terms {
  alignas(64) float a[6][MatchKernel::kMost], arm[3][MatchKernel::kMost];
  alignas(64) float r[MatchKernel::kMost], weight[MatchKernel::kMost], stiffness[MatchKernel::kMost],
      cost[MatchKernel::kMost], one[MatchKernel::kMost];
};

GANTRY_MULTIVERSION void terms_of(const Setup& s, const MatchKernel::Pairs& in, Terms& __restrict out) {
  const float central = s.target_central ? 1.0f : 0.0f;
  for (int k = 0; k < in.count; ++k) {
    const Unpacked m = unpack(in.a[k], in.b[k]);
    const float agree = m.x * in.nx[k] + m.y * in.ny[k] + m.z * in.nz[k];
    const float sx = m.x + in.nx[k], sy = m.y + in.ny[k], sz = m.z + in.nz[k];
    const float by = 1.0f / std::sqrt(sx * sx + sy * sy + sz * sz + 1e-12f);
    const float nx = sx * by, ny = sy * by, nz = sz * by;
    const float along_ray = nx * in.px[k] + ny * in.py[k] + nz * in.pz[k];
    const float d = central != 0 ? along_ray * (1 - in.w[k] / in.q_w[k]) : nz * (in.w[k] - in.q_w[k]);
    const float ok = (agree >= s.cosine) & (std::fabs(d) <= s.reach) ? 1.0f : 0.0f;
    const float loss = s.scale_squared / (s.scale_squared + d * d);
    const float ax = in.px[k] - s.centre[0], ay = in.py[k] - s.centre[1], az = in.pz[k] - s.centre[2];
    out.arm[0][k] = ax;
    out.arm[1][k] = ay;
    out.arm[2][k] = az;
    out.a[0][k] = ay * nz - az * ny;
    out.a[1][k] = az * nx - ax * nz;
    out.a[2][k] = ax * ny - ay * nx;
    out.a[3][k] = nx;
    out.a[4][k] = ny;
    out.a[5][k] = nz;
    out.r[k] = d;
    out.weight[k] = ok * loss * loss;
    out.stiffness[k] = ok * loss * loss * (4 * loss - 3);
    out.cost[k] = ok * loss * d * d;
    out.one[k] = ok;
  }
}

inline __attribute__((always_inline)) float sum_of(const float* __restrict x, int count) {
  float sum = 0;
#pragma omp simd reduction(+ : sum)
  for (int k = 0; k < count; ++k) sum += x[k];
  return sum;
}

inline __attribute__((always_inline)) float dot(const float* __restrict x, const float* __restrict y,
                                                int count) {
  float sum = 0;
#pragma omp simd reduction(+ : sum)
  for (int k = 0; k < count; ++k) sum += x[k] * y[k];
  return sum;
}

GANTRY_MULTIVERSION void reduce(const Terms& t, int count, MatchKernel::Sums& sums) {
  alignas(64) float weighted[MatchKernel::kMost];
  int h = 0;
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < count; ++k) weighted[k] = t.weight[k] * t.a[i][k];
    for (int j = i; j < 6; ++j) sums.hessian[h++] = dot(weighted, t.a[j], count);
    sums.gradient[i] = dot(weighted, t.r, count);
  }
  h = 0;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < count; ++k) weighted[k] = t.weight[k] * t.arm[i][k];
    sums.arms[i] = sum_of(weighted, count);
    for (int j = i; j < 3; ++j) sums.squares[h++] = dot(weighted, t.arm[j], count);
    sums.place[i] = dot(t.one, t.arm[i], count);
  }
  sums.weight = sum_of(t.weight, count);
  sums.stiffness = sum_of(t.stiffness, count);
  sums.cost = sum_of(t.cost, count);
  sums.matches = sum_of(t.one, count);
}

}  // namespace

void MatchKernel::project(Pixels& pixels, Falls& falls) const {
  if (!source_distorted) rays_of(*this, pixels);
  transform(*this, pixels, falls);
  look(*this, pixels.count, falls);
}

void MatchKernel::sum(const Pairs& pairs, Sums& sums) const {
  Terms terms;
  terms_of(*this, pairs, terms);
  reduce(terms, pairs.count, sums);
}

}  // namespace gantry::internal
