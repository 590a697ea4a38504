// Packs of float in four NEON registers each. Needs no more than every 64-bit ARM has.
//
// A mask is four registers whose lanes are all ones or all zeros, which is what comparisons give
// and what blending takes; it becomes bits only where a kernel asks for them.
#pragma once

#include <arm_neon.h>

namespace gsfw {
namespace GSFW_ISA {

/// Registers of a pack, and lanes of a register.
constexpr int QUADS = 4;
constexpr int QUAD = LANES / QUADS;

template <>
struct LaneMask<float> {
  uint32x4_t quad[QUADS];

  GSFW_FUNCTION LaneMask() {}

  GSFW_FUNCTION friend LaneMask operator&(const LaneMask& a, const LaneMask& b) {
    LaneMask r;
    for (int q = 0; q < QUADS; ++q) r.quad[q] = vandq_u32(a.quad[q], b.quad[q]);
    return r;
  }
  GSFW_FUNCTION friend LaneMask operator|(const LaneMask& a, const LaneMask& b) {
    LaneMask r;
    for (int q = 0; q < QUADS; ++q) r.quad[q] = vorrq_u32(a.quad[q], b.quad[q]);
    return r;
  }
  GSFW_FUNCTION friend LaneMask operator!(const LaneMask& a) {
    LaneMask r;
    for (int q = 0; q < QUADS; ++q) r.quad[q] = vmvnq_u32(a.quad[q]);
    return r;
  }
};

// Every operation is the same instruction on each register of its arguments.
#define GSFW_QUADS(Result, expression)                      \
  Result r;                                                 \
  for (int q = 0; q < QUADS; ++q) r.quad[q] = (expression); \
  return r;

template <>
struct Pack<float> {
  float32x4_t quad[QUADS];

  GSFW_FUNCTION Pack() {}
  GSFW_FUNCTION Pack(double value) {
    for (int q = 0; q < QUADS; ++q) quad[q] = vdupq_n_f32(float(value));
  }

  GSFW_FUNCTION friend Pack operator+(const Pack& a, const Pack& b) {
    GSFW_QUADS(Pack, vaddq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend Pack operator-(const Pack& a, const Pack& b) {
    GSFW_QUADS(Pack, vsubq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend Pack operator*(const Pack& a, const Pack& b) {
    GSFW_QUADS(Pack, vmulq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend Pack operator/(const Pack& a, const Pack& b) {
    GSFW_QUADS(Pack, vdivq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend Pack operator-(const Pack& a) {
    GSFW_QUADS(Pack, vnegq_f32(a.quad[q]))
  }
  GSFW_FUNCTION friend LaneMask<float> operator<(const Pack& a, const Pack& b) {
    GSFW_QUADS(LaneMask<float>, vcltq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend LaneMask<float> operator<=(const Pack& a, const Pack& b) {
    GSFW_QUADS(LaneMask<float>, vcleq_f32(a.quad[q], b.quad[q]))
  }
  GSFW_FUNCTION friend LaneMask<float> operator>(const Pack& a, const Pack& b) { return b < a; }
  GSFW_FUNCTION friend LaneMask<float> operator>=(const Pack& a, const Pack& b) { return b <= a; }
};

GSFW_FUNCTION uint32_t bits_of(const LaneMask<float>& mask) {
  const uint16x8_t low = vcombine_u16(vmovn_u32(mask.quad[0]), vmovn_u32(mask.quad[1]));
  const uint16x8_t high = vcombine_u16(vmovn_u32(mask.quad[2]), vmovn_u32(mask.quad[3]));
  const uint16x8_t weights = {1, 2, 4, 8, 16, 32, 64, 128};
  return uint32_t(vaddvq_u16(vandq_u16(low, weights))) |
         uint32_t(vaddvq_u16(vandq_u16(high, weights))) << 8;
}

GSFW_FUNCTION bool any(const LaneMask<float>& mask) {
  return vmaxvq_u32(vorrq_u32(vorrq_u32(mask.quad[0], mask.quad[1]),
                              vorrq_u32(mask.quad[2], mask.quad[3]))) != 0;
}

template <>
GSFW_FUNCTION LaneMask<float> lanes_of<float>(uint32_t bits) {
  const uint32x4_t first = {1, 2, 4, 8};
  GSFW_QUADS(LaneMask<float>, vtstq_u32(vdupq_n_u32(bits >> (q * QUAD)), first))
}

template <>
GSFW_FUNCTION LaneMask<float> first_lanes<float>(int64_t count) {
  const int32x4_t first = {0, 1, 2, 3};
  const int there = count >= LANES ? LANES : int(count);
  GSFW_QUADS(LaneMask<float>, vcltq_s32(first, vdupq_n_s32(there - q * QUAD)))
}

GSFW_FUNCTION Pack<float> load(const float* from) {
  GSFW_QUADS(Pack<float>, vld1q_f32(from + q * QUAD))
}

GSFW_FUNCTION void store(float* to, const Pack<float>& a) {
  for (int q = 0; q < QUADS; ++q) vst1q_f32(to + q * QUAD, a.quad[q]);
}

// The set neither gathers nor scatters, nor loads or stores under a mask: lane by lane.
GSFW_FUNCTION Pack<float> load_strided(const float* from, int64_t stride, int64_t count) {
  if (stride == 1 && count >= LANES) return load(from);
  alignas(16) float lanes[LANES] = {};
  for (int i = 0; i < LANES && i < count; ++i) lanes[i] = from[i * stride];
  return load(lanes);
}

GSFW_FUNCTION void store_strided(float* to, int64_t stride, const LaneMask<float>& mask,
                                 const Pack<float>& a) {
  const uint32_t bits = bits_of(mask);
  if (stride == 1 && bits == 0xffffu) return store(to, a);
  alignas(16) float lanes[LANES];
  store(lanes, a);
  for (uint32_t rest = bits; rest; rest &= rest - 1) {
    const int i = __builtin_ctz(rest);
    to[i * stride] = lanes[i];
  }
}

GSFW_FUNCTION Pack<float> select(const LaneMask<float>& mask, const Pack<float>& a,
                                 const Pack<float>& b) {
  GSFW_QUADS(Pack<float>, vbslq_f32(mask.quad[q], a.quad[q], b.quad[q]))
}

GSFW_FUNCTION Pack<float> keep(const LaneMask<float>& mask, const Pack<float>& a) {
  return select(mask, a, Pack<float>(0.0));
}

GSFW_FUNCTION Pack<float> square_root(const Pack<float>& a) {
  GSFW_QUADS(Pack<float>, vsqrtq_f32(a.quad[q]))
}

GSFW_FUNCTION Pack<float> absolute(const Pack<float>& a) {
  GSFW_QUADS(Pack<float>, vabsq_f32(a.quad[q]))
}

GSFW_FUNCTION Pack<float> round_down(const Pack<float>& a) {
  GSFW_QUADS(Pack<float>, vrndmq_f32(a.quad[q]))
}

GSFW_FUNCTION Pack<float> logarithm_of_two(const Pack<float>& a) {
  alignas(16) float lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < LANES; ++i) lanes[i] = GSFW_ELEMENTARY(log2f)(lanes[i]);
  return load(lanes);
}

GSFW_FUNCTION Pack<float> arc_tangent(const Pack<float>& a) {
  alignas(16) float lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < LANES; ++i) lanes[i] = arc_tangent(lanes[i]);
  return load(lanes);
}

// Not fmin and fmax, which give NaN for a NaN on either side.
GSFW_FUNCTION Pack<float> minimum(const Pack<float>& a, const Pack<float>& b) {
  return select(a < b, a, b);
}

GSFW_FUNCTION Pack<float> maximum(const Pack<float>& a, const Pack<float>& b) {
  return select(a > b, a, b);
}

GSFW_FUNCTION Pack<float> fma(const Pack<float>& a, const Pack<float>& b, const Pack<float>& c) {
  GSFW_QUADS(Pack<float>, vfmaq_f32(c.quad[q], a.quad[q], b.quad[q]))
}

GSFW_FUNCTION Pack<float> fma_negated(const Pack<float>& a, const Pack<float>& b,
                                      const Pack<float>& c) {
  GSFW_QUADS(Pack<float>, vfmsq_f32(c.quad[q], a.quad[q], b.quad[q]))
}

/// The four sums of lanes that are four apart.
GSFW_FUNCTION float32x4_t quarter_sums(const Pack<float>& a) {
  return vaddq_f32(vaddq_f32(a.quad[0], a.quad[2]), vaddq_f32(a.quad[1], a.quad[3]));
}

GSFW_FUNCTION float sum(const Pack<float>& a) {
  const float32x4_t quarters = quarter_sums(a);
  const float32x2_t halves = vadd_f32(vget_low_f32(quarters), vget_high_f32(quarters));
  return vget_lane_f32(halves, 0) + vget_lane_f32(halves, 1);
}

GSFW_FUNCTION void sum_eight(const Pack<float>* packs, float* to) {
  for (int i = 0; i < 8; i += 4) {
    const float32x4_t low = vpaddq_f32(quarter_sums(packs[i]), quarter_sums(packs[i + 1]));
    const float32x4_t high = vpaddq_f32(quarter_sums(packs[i + 2]), quarter_sums(packs[i + 3]));
    vst1q_f32(to + i, vpaddq_f32(low, high));
  }
}

/// The four by four lanes of four registers, as columns from rows.
GSFW_FUNCTION void transpose(const float32x4_t* rows, float32x4_t* columns) {
  const float32x4_t even_low = vzip1q_f32(rows[0], rows[2]);
  const float32x4_t even_high = vzip2q_f32(rows[0], rows[2]);
  const float32x4_t odd_low = vzip1q_f32(rows[1], rows[3]);
  const float32x4_t odd_high = vzip2q_f32(rows[1], rows[3]);
  columns[0] = vzip1q_f32(even_low, odd_low);
  columns[1] = vzip2q_f32(even_low, odd_low);
  columns[2] = vzip1q_f32(even_high, odd_high);
  columns[3] = vzip2q_f32(even_high, odd_high);
}

GSFW_FUNCTION void transpose(Pack<float>* packs) {
  Pack<float> columns[LANES];
  for (int i = 0; i < LANES; i += QUAD) {
    for (int q = 0; q < QUADS; ++q) {
      const float32x4_t rows[QUAD] = {packs[i].quad[q], packs[i + 1].quad[q],
                                      packs[i + 2].quad[q], packs[i + 3].quad[q]};
      float32x4_t turned[QUAD];
      transpose(rows, turned);
      for (int k = 0; k < QUAD; ++k) columns[q * QUAD + k].quad[i / QUAD] = turned[k];
    }
  }
  for (int i = 0; i < LANES; ++i) packs[i] = columns[i];
}

GSFW_FUNCTION float32x4_t power_of_two(float32x4_t a) {
  // Adding 1.5 * 2^23 rounds to an integer, whose low bits are then the mantissa's.
  const float32x4_t shift = vdupq_n_f32(12582912.0f);
  const float32x4_t x = vmaxq_f32(a, vdupq_n_f32(LEAST_EXPONENT));
  const float32x4_t shifted = vaddq_f32(x, shift);
  const float32x4_t f = vsubq_f32(x, vsubq_f32(shifted, shift));
  float32x4_t p = vdupq_n_f32(POWER_OF_TWO[5]);
  for (int k = 4; k >= 0; --k) p = vfmaq_f32(vdupq_n_f32(POWER_OF_TWO[k]), p, f);
  const uint32x4_t exponent = vshlq_n_u32(vreinterpretq_u32_f32(shifted), 23);
  return vreinterpretq_f32_u32(vaddq_u32(vreinterpretq_u32_f32(p), exponent));
}

GSFW_FUNCTION Pack<float> power_of_two(const Pack<float>& a) {
  GSFW_QUADS(Pack<float>, power_of_two(a.quad[q]))
}

#undef GSFW_QUADS

GSFW_FUNCTION void bit_ranges(const Pack<float>& first, const Pack<float>& end, uint16_t* to) {
  const uint32x4_t one = vdupq_n_u32(1);
  for (int q = 0; q < QUADS; ++q) {
    const uint32x4_t above = vshlq_u32(one, vcvtq_s32_f32(end.quad[q]));
    const uint32x4_t below = vshlq_u32(one, vcvtq_s32_f32(first.quad[q]));
    vst1_u16(to + q * QUAD, vmovn_u32(vsubq_u32(above, below)));
  }
}

GSFW_FUNCTION void split_by_bit(const uint32_t* blocks, int count, uint16_t* lists, int capacity,
                                int* lengths) {
  for (int b = 0; b < LANES; ++b) {
    uint16_t* list = lists + b * capacity;
    int length = 0;
    // Every index is written, and stays when the next one is written behind it: no branches.
    for (int i = 0; i < count; ++i) {
      list[length] = uint16_t(i);
      length += blocks[i] >> b & 1;
    }
    lengths[b] = length;
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
