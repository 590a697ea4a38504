// Packs and masks in plain C++: what float64 and the scalar instruction set use, and the meaning of
// every operation that the other headers write with intrinsics.
#pragma once

#include <stdint.h>
#include <string.h>

#include "number.h"

namespace gsfw {
namespace GSFW_ISA {

/// Lanes of a pack, and pixels of a block.
constexpr int LANES = 16;

GSFW_FUNCTION float round_down(float x) { return GSFW_ELEMENTARY(floorf)(x); }
GSFW_FUNCTION double round_down(double x) { return GSFW_ELEMENTARY(floor)(x); }

/// Sixteen truths.
template <typename T>
struct LaneMask {
  uint32_t bits;

  GSFW_FUNCTION LaneMask() {}
  GSFW_FUNCTION explicit LaneMask(uint32_t lanes) : bits(lanes) {}

  GSFW_FUNCTION friend LaneMask operator&(LaneMask a, LaneMask b) {
    return LaneMask(a.bits & b.bits);
  }
  GSFW_FUNCTION friend LaneMask operator|(LaneMask a, LaneMask b) {
    return LaneMask(a.bits | b.bits);
  }
  GSFW_FUNCTION friend LaneMask operator!(LaneMask a) { return LaneMask(~a.bits & 0xffffu); }
};

/// Sixteen numbers.
template <typename T>
struct Pack {
  T lane[LANES];

  GSFW_FUNCTION Pack() {}
  GSFW_FUNCTION Pack(double value) {
    for (int i = 0; i < LANES; ++i) lane[i] = T(value);
  }

#define GSFW_LANEWISE(op)                                              \
  GSFW_FUNCTION friend Pack operator op(const Pack& a, const Pack& b) { \
    Pack r;                                                            \
    for (int i = 0; i < LANES; ++i) r.lane[i] = a.lane[i] op b.lane[i]; \
    return r;                                                          \
  }
  GSFW_LANEWISE(+)
  GSFW_LANEWISE(-)
  GSFW_LANEWISE(*)
  GSFW_LANEWISE(/)
#undef GSFW_LANEWISE

#define GSFW_COMPARE(op)                                                   \
  GSFW_FUNCTION friend LaneMask<T> operator op(const Pack& a, const Pack& b) {  \
    uint32_t bits = 0;                                                     \
    for (int i = 0; i < LANES; ++i) bits |= uint32_t(a.lane[i] op b.lane[i]) << i; \
    return LaneMask<T>(bits);                                                  \
  }
  GSFW_COMPARE(<)
  GSFW_COMPARE(<=)
  GSFW_COMPARE(>)
  GSFW_COMPARE(>=)
#undef GSFW_COMPARE

  GSFW_FUNCTION friend Pack operator-(const Pack& a) {
    Pack r;
    for (int i = 0; i < LANES; ++i) r.lane[i] = -a.lane[i];
    return r;
  }
};

/// Lanes of a pack that are taken at a time where many sums are kept, so that these fit into the
/// registers: all of them, or what one register holds.
template <typename T>
struct PartOf {
  using Type = Pack<T>;
  static constexpr int WIDTH = LANES;
};

template <typename T>
using Part = typename PartOf<T>::Type;

template <typename T>
constexpr int PART_LANES = PartOf<T>::WIDTH;

template <typename T>
GSFW_FUNCTION uint32_t bits_of(LaneMask<T> mask) {
  return mask.bits;
}

template <typename T>
GSFW_FUNCTION bool any(LaneMask<T> mask) {
  return mask.bits != 0;
}

/// The first ``count`` lanes; all of them from 16 on.
template <typename T>
GSFW_FUNCTION LaneMask<T> first_lanes(int64_t count) {
  return LaneMask<T>(count >= LANES ? 0xffffu : (1u << count) - 1u);
}

template <typename T>
GSFW_FUNCTION LaneMask<T> lanes_of(uint32_t bits) {
  return LaneMask<T>(bits);
}

template <typename T>
GSFW_FUNCTION Pack<T> load(const T* from) {
  Pack<T> r;
  memcpy(r.lane, from, sizeof(r.lane));
  return r;
}

template <typename T>
GSFW_FUNCTION void store(T* to, const Pack<T>& a) {
  memcpy(to, a.lane, sizeof(a.lane));
}

/// Lane i is ``from[i * stride]``; lanes from ``count`` on are 0 and not read.
template <typename T>
GSFW_FUNCTION Pack<T> load_strided(const T* from, int64_t stride, int64_t count) {
  Pack<T> r(T(0));
  for (int i = 0; i < LANES && i < count; ++i) r.lane[i] = from[i * stride];
  return r;
}

/// Write lane i to ``to[i * stride]`` where the mask holds.
template <typename T>
GSFW_FUNCTION void store_strided(T* to, int64_t stride, LaneMask<T> mask, const Pack<T>& a) {
  for (int i = 0; i < LANES; ++i) {
    if (mask.bits >> i & 1) to[i * stride] = a.lane[i];
  }
}

template <typename T>
GSFW_FUNCTION Pack<T> select(LaneMask<T> mask, const Pack<T>& a, const Pack<T>& b) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = mask.bits >> i & 1 ? a.lane[i] : b.lane[i];
  return r;
}

/// ``a`` where the mask holds, 0 elsewhere.
template <typename T>
GSFW_FUNCTION Pack<T> keep(LaneMask<T> mask, const Pack<T>& a) {
  return select(mask, a, Pack<T>(T(0)));
}

#define GSFW_MAP1(name, expression)               \
  template <typename T>                           \
  GSFW_FUNCTION Pack<T> name(const Pack<T>& a) {   \
    Pack<T> r;                                    \
    for (int i = 0; i < LANES; ++i) {             \
      const T x = a.lane[i];                      \
      r.lane[i] = (expression);                   \
    }                                             \
    return r;                                     \
  }
GSFW_MAP1(square_root, square_root(x))
GSFW_MAP1(absolute, absolute(x))
GSFW_MAP1(arc_tangent, arc_tangent(x))
GSFW_MAP1(round_down, round_down(x))
GSFW_MAP1(logarithm_of_two, T(GSFW_ELEMENTARY(log2)(double(x))))
#undef GSFW_MAP1

/// As one instruction has it: the second one where a comparison with NaN fails.
template <typename T>
GSFW_FUNCTION Pack<T> minimum(const Pack<T>& a, const Pack<T>& b) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = a.lane[i] < b.lane[i] ? a.lane[i] : b.lane[i];
  return r;
}

template <typename T>
GSFW_FUNCTION Pack<T> maximum(const Pack<T>& a, const Pack<T>& b) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = a.lane[i] > b.lane[i] ? a.lane[i] : b.lane[i];
  return r;
}

/// a b + c; rounded once only where the instruction set has it, but always the same way.
template <typename T>
GSFW_FUNCTION Pack<T> fma(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = fma(a.lane[i], b.lane[i], c.lane[i]);
  return r;
}

/// c - a b.
template <typename T>
GSFW_FUNCTION Pack<T> fma_negated(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = fma(-a.lane[i], b.lane[i], c.lane[i]);
  return r;
}

template <typename T>
GSFW_FUNCTION T sum(const Pack<T>& a) {
  T half[LANES];
  memcpy(half, a.lane, sizeof(half));
  for (int width = LANES / 2; width > 0; width /= 2) {
    for (int i = 0; i < width; ++i) half[i] = half[i] + half[i + width];
  }
  return half[0];
}

/// The sums of eight packs, written to ``to[0..7]``.
template <typename T>
GSFW_FUNCTION void sum_eight(const Pack<T>* packs, T* to) {
  for (int i = 0; i < 8; ++i) to[i] = sum(packs[i]);
}

/// 2 to the power of each lane.
template <typename T>
GSFW_FUNCTION Pack<T> power_of_two(const Pack<T>& a) {
  Pack<T> r;
  for (int i = 0; i < LANES; ++i) r.lane[i] = T(GSFW_ELEMENTARY(exp2)(double(a.lane[i])));
  return r;
}

/// Coefficients of 2^f on [-1/2, 1/2], the minimax polynomial of degree 5 for relative error:
/// 7.5e-8, and 2.1e-7 as float32 evaluates it with fused operations, 2.6e-7 without (own Remez
/// exchange).
constexpr float POWER_OF_TWO[6] = {1.000000072f,     6.931469671e-1f,  2.402211972e-1f,
                                   5.550713273e-2f, 9.675541334e-3f, 1.327647199e-3f};

/// Exponents under this have no normal float32, and count as this.
constexpr float LEAST_EXPONENT = -126.0f;

#if !defined(GSFW_SIMD_avx512) && !defined(GSFW_SIMD_avx2) && !defined(GSFW_SIMD_neon)
/// The same polynomial as the vector sets have, so that the scalar set is no more exact than they.
GSFW_FUNCTION Pack<float> power_of_two(const Pack<float>& a) {
  Pack<float> r;
  for (int i = 0; i < LANES; ++i) {
    const float x = a.lane[i] > LEAST_EXPONENT ? a.lane[i] : LEAST_EXPONENT;
    // Adding 1.5 * 2^23 rounds to an integer, whose low bits are then the mantissa's.
    const float shifted = x + 12582912.0f;
    const float f = x - (shifted - 12582912.0f);
    float p = POWER_OF_TWO[5];
    for (int k = 4; k >= 0; --k) p = p * f + POWER_OF_TWO[k];
    uint32_t exponent, bits;
    memcpy(&exponent, &shifted, 4);
    memcpy(&bits, &p, 4);
    bits += exponent << 23;
    memcpy(&r.lane[i], &bits, 4);
  }
  return r;
}

/// Append i to list b of sixteen for every bit b of ``blocks[i]``.
///
/// ``lists`` are ``capacity`` apart, which leaves room for 16 more than are appended.
GSFW_FUNCTION void split_by_bit(const uint32_t* blocks, int count, uint16_t* lists, int capacity,
                                int* lengths) {
  for (int b = 0; b < LANES; ++b) {
    uint16_t* list = lists + b * capacity;
    int length = 0;
    for (int i = 0; i < count; ++i) {
      list[length] = uint16_t(i);
      length += blocks[i] >> b & 1;
    }
    lengths[b] = length;
  }
}
#endif

}  // namespace GSFW_ISA
}  // namespace gsfw
