// Packs of float in two AVX2 registers each. Needs FMA and POPCNT as well.
//
// A mask is two registers whose lanes are all ones or all zeros, which is what comparisons give and
// what blending takes; it becomes bits only where a kernel asks for them.
#pragma once

#include <immintrin.h>

namespace gsfw {
namespace GSFW_ISA {

template <>
struct LaneMask<float> {
  __m256 low, high;

  GSFW_FUNCTION LaneMask() {}
  GSFW_FUNCTION LaneMask(__m256 lanes_0, __m256 lanes_8) : low(lanes_0), high(lanes_8) {}
  GSFW_FUNCTION LaneMask(__m256i lanes_0, __m256i lanes_8)
      : low(_mm256_castsi256_ps(lanes_0)), high(_mm256_castsi256_ps(lanes_8)) {}

  GSFW_FUNCTION friend LaneMask operator&(LaneMask a, LaneMask b) {
    return {_mm256_and_ps(a.low, b.low), _mm256_and_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend LaneMask operator|(LaneMask a, LaneMask b) {
    return {_mm256_or_ps(a.low, b.low), _mm256_or_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend LaneMask operator!(LaneMask a) {
    const __m256 ones = _mm256_castsi256_ps(_mm256_set1_epi32(-1));
    return {_mm256_xor_ps(a.low, ones), _mm256_xor_ps(a.high, ones)};
  }
};

template <>
struct Pack<float> {
  __m256 low, high;

  GSFW_FUNCTION Pack() {}
  GSFW_FUNCTION Pack(double value) : low(_mm256_set1_ps(float(value))), high(low) {}
  GSFW_FUNCTION Pack(__m256 lanes_0, __m256 lanes_8) : low(lanes_0), high(lanes_8) {}

  GSFW_FUNCTION friend Pack operator+(Pack a, Pack b) {
    return {_mm256_add_ps(a.low, b.low), _mm256_add_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend Pack operator-(Pack a, Pack b) {
    return {_mm256_sub_ps(a.low, b.low), _mm256_sub_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend Pack operator*(Pack a, Pack b) {
    return {_mm256_mul_ps(a.low, b.low), _mm256_mul_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend Pack operator/(Pack a, Pack b) {
    return {_mm256_div_ps(a.low, b.low), _mm256_div_ps(a.high, b.high)};
  }
  GSFW_FUNCTION friend Pack operator-(Pack a) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    return {_mm256_xor_ps(a.low, sign), _mm256_xor_ps(a.high, sign)};
  }
  GSFW_FUNCTION friend LaneMask<float> operator<(Pack a, Pack b) {
    return {_mm256_cmp_ps(a.low, b.low, _CMP_LT_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_LT_OQ)};
  }
  GSFW_FUNCTION friend LaneMask<float> operator<=(Pack a, Pack b) {
    return {_mm256_cmp_ps(a.low, b.low, _CMP_LE_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_LE_OQ)};
  }
  GSFW_FUNCTION friend LaneMask<float> operator>(Pack a, Pack b) { return b < a; }
  GSFW_FUNCTION friend LaneMask<float> operator>=(Pack a, Pack b) { return b <= a; }
};

GSFW_FUNCTION uint32_t bits_of(LaneMask<float> mask) {
  return uint32_t(_mm256_movemask_ps(mask.low)) | uint32_t(_mm256_movemask_ps(mask.high)) << 8;
}

GSFW_FUNCTION bool any(LaneMask<float> mask) {
  return _mm256_movemask_ps(_mm256_or_ps(mask.low, mask.high)) != 0;
}

template <>
GSFW_FUNCTION LaneMask<float> lanes_of<float>(uint32_t bits) {
  const __m256i all = _mm256_set1_epi32(int(bits));
  const __m256i low = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  const __m256i high = _mm256_slli_epi32(low, 8);
  return {_mm256_cmpeq_epi32(_mm256_and_si256(all, low), low),
          _mm256_cmpeq_epi32(_mm256_and_si256(all, high), high)};
}

template <>
GSFW_FUNCTION LaneMask<float> first_lanes<float>(int64_t count) {
  const __m256i all = _mm256_set1_epi32(count >= LANES ? LANES : int(count));
  return {_mm256_cmpgt_epi32(all, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)),
          _mm256_cmpgt_epi32(all, _mm256_setr_epi32(8, 9, 10, 11, 12, 13, 14, 15))};
}

GSFW_FUNCTION Pack<float> load(const float* from) {
  return {_mm256_loadu_ps(from), _mm256_loadu_ps(from + 8)};
}

GSFW_FUNCTION void store(float* to, Pack<float> a) {
  _mm256_storeu_ps(to, a.low);
  _mm256_storeu_ps(to + 8, a.high);
}

GSFW_FUNCTION Pack<float> load_strided(const float* from, int64_t stride, int64_t count) {
  if (stride == 1 && count >= LANES) return load(from);
  const LaneMask<float> mask = first_lanes<float>(count);
  if (stride == 1) {
    return {_mm256_maskload_ps(from, _mm256_castps_si256(mask.low)),
            _mm256_maskload_ps(from + 8, _mm256_castps_si256(mask.high))};
  }
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  const __m256i index = _mm256_mullo_epi32(lanes, _mm256_set1_epi32(int(stride)));
  const __m256 zero = _mm256_setzero_ps();
  return {_mm256_mask_i32gather_ps(zero, from, index, mask.low, 4),
          _mm256_mask_i32gather_ps(zero, from + 8 * stride, index, mask.high, 4)};
}

// The set has no scatter, and storing under a mask is microcode on some CPUs: lane by lane.
GSFW_FUNCTION void store_strided(float* to, int64_t stride, LaneMask<float> mask, Pack<float> a) {
  const uint32_t bits = bits_of(mask);
  if (stride == 1 && bits == 0xffffu) return store(to, a);
  alignas(32) float lanes[LANES];
  store(lanes, a);
  for (uint32_t rest = bits; rest; rest &= rest - 1) {
    const int i = __builtin_ctz(rest);
    to[i * stride] = lanes[i];
  }
}

// Row by row, which writes each line of the cache once.
template <int FIELDS>
GSFW_FUNCTION void store_rows(float* to, int64_t count, const Pack<float>* fields) {
  alignas(32) float lanes[FIELDS][LANES];
  for (int k = 0; k < FIELDS; ++k) store(lanes[k], fields[k]);
  for (int i = 0; i < LANES && i < count; ++i) {
    for (int k = 0; k < FIELDS; ++k) to[i * FIELDS + k] = lanes[k][i];
  }
}

GSFW_FUNCTION Pack<float> select(LaneMask<float> mask, Pack<float> a, Pack<float> b) {
  return {_mm256_blendv_ps(b.low, a.low, mask.low), _mm256_blendv_ps(b.high, a.high, mask.high)};
}

GSFW_FUNCTION Pack<float> keep(LaneMask<float> mask, Pack<float> a) {
  return {_mm256_and_ps(mask.low, a.low), _mm256_and_ps(mask.high, a.high)};
}

GSFW_FUNCTION Pack<float> square_root(Pack<float> a) {
  return {_mm256_sqrt_ps(a.low), _mm256_sqrt_ps(a.high)};
}

GSFW_FUNCTION Pack<float> absolute(Pack<float> a) {
  const __m256 sign = _mm256_set1_ps(-0.0f);
  return {_mm256_andnot_ps(sign, a.low), _mm256_andnot_ps(sign, a.high)};
}

GSFW_FUNCTION Pack<float> round_down(Pack<float> a) {
  return {_mm256_floor_ps(a.low), _mm256_floor_ps(a.high)};
}

GSFW_FUNCTION Pack<float> logarithm_of_two(Pack<float> a) {
  alignas(32) float lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < LANES; ++i) lanes[i] = GSFW_ELEMENTARY(log2f)(lanes[i]);
  return load(lanes);
}

GSFW_FUNCTION Pack<float> arc_tangent(Pack<float> a) {
  alignas(32) float lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < LANES; ++i) lanes[i] = arc_tangent(lanes[i]);
  return load(lanes);
}

GSFW_FUNCTION Pack<float> minimum(Pack<float> a, Pack<float> b) {
  return {_mm256_min_ps(a.low, b.low), _mm256_min_ps(a.high, b.high)};
}

GSFW_FUNCTION Pack<float> maximum(Pack<float> a, Pack<float> b) {
  return {_mm256_max_ps(a.low, b.low), _mm256_max_ps(a.high, b.high)};
}

GSFW_FUNCTION Pack<float> fma(Pack<float> a, Pack<float> b, Pack<float> c) {
  return {_mm256_fmadd_ps(a.low, b.low, c.low), _mm256_fmadd_ps(a.high, b.high, c.high)};
}

GSFW_FUNCTION Pack<float> fma_negated(Pack<float> a, Pack<float> b, Pack<float> c) {
  return {_mm256_fnmadd_ps(a.low, b.low, c.low), _mm256_fnmadd_ps(a.high, b.high, c.high)};
}

/// One register's lanes of a pack: sums of nine packs would need eighteen registers of sixteen.
struct Eight {
  __m256 v;

  GSFW_FUNCTION Eight() {}
  GSFW_FUNCTION Eight(double value) : v(_mm256_set1_ps(float(value))) {}
  GSFW_FUNCTION Eight(__m256 value) : v(value) {}

  GSFW_FUNCTION friend Eight operator+(Eight a, Eight b) { return _mm256_add_ps(a.v, b.v); }
  GSFW_FUNCTION friend Eight operator-(Eight a, Eight b) { return _mm256_sub_ps(a.v, b.v); }
  GSFW_FUNCTION friend Eight operator*(Eight a, Eight b) { return _mm256_mul_ps(a.v, b.v); }
  GSFW_FUNCTION friend Eight operator<=(Eight a, Eight b) {
    return _mm256_cmp_ps(a.v, b.v, _CMP_LE_OQ);
  }
};

template <>
struct PartOf<float> {
  using Type = Eight;
  static constexpr int WIDTH = 8;
};

GSFW_FUNCTION Eight load_part(const float* from) { return _mm256_loadu_ps(from); }

GSFW_FUNCTION void store(float* to, Eight a) { _mm256_storeu_ps(to, a.v); }

GSFW_FUNCTION Eight keep(Eight mask, Eight a) { return _mm256_and_ps(mask.v, a.v); }

GSFW_FUNCTION Eight absolute(Eight a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a.v); }

GSFW_FUNCTION Eight fma(Eight a, Eight b, Eight c) { return _mm256_fmadd_ps(a.v, b.v, c.v); }

GSFW_FUNCTION float sum(Eight a) {
  const __m128 quarter =
      _mm_add_ps(_mm256_castps256_ps128(a.v), _mm256_extractf128_ps(a.v, 1));
  const __m128 pair = _mm_add_ps(quarter, _mm_movehl_ps(quarter, quarter));
  return _mm_cvtss_f32(_mm_add_ss(pair, _mm_movehdup_ps(pair)));
}

GSFW_FUNCTION float sum(Pack<float> a) { return sum(Eight(_mm256_add_ps(a.low, a.high))); }

GSFW_FUNCTION void sum_eight(const Eight* p, float* to) {
  // Each level adds the halves of two registers into one, until lane i holds the sum of pack i.
  const __m256 a = _mm256_hadd_ps(p[0].v, p[1].v), b = _mm256_hadd_ps(p[2].v, p[3].v);
  const __m256 c = _mm256_hadd_ps(p[4].v, p[5].v), d = _mm256_hadd_ps(p[6].v, p[7].v);
  const __m256 e = _mm256_hadd_ps(a, b), f = _mm256_hadd_ps(c, d);
  const __m256 low = _mm256_permute2f128_ps(e, f, 0x20), high = _mm256_permute2f128_ps(e, f, 0x31);
  _mm256_storeu_ps(to, _mm256_add_ps(low, high));
}

GSFW_FUNCTION void sum_eight(const Pack<float>* packs, float* to) {
  Eight halves[8];
  for (int i = 0; i < 8; ++i) halves[i] = _mm256_add_ps(packs[i].low, packs[i].high);
  sum_eight(halves, to);
}

/// The eight by eight lanes of eight registers.
GSFW_FUNCTION void transpose(__m256* rows) {
  // Pairs of rows, then pairs of pairs, then halves of registers: 2 by 2 lanes, 4 by 4, all.
  __m256 a[8], b[8];
  for (int i = 0; i < 8; i += 2) {
    a[i] = _mm256_unpacklo_ps(rows[i], rows[i + 1]);
    a[i + 1] = _mm256_unpackhi_ps(rows[i], rows[i + 1]);
  }
  for (int i = 0; i < 8; i += 4) {
    b[i] = _mm256_shuffle_ps(a[i], a[i + 2], 0x44);
    b[i + 1] = _mm256_shuffle_ps(a[i], a[i + 2], 0xee);
    b[i + 2] = _mm256_shuffle_ps(a[i + 1], a[i + 3], 0x44);
    b[i + 3] = _mm256_shuffle_ps(a[i + 1], a[i + 3], 0xee);
  }
  for (int i = 0; i < 4; ++i) {
    rows[i] = _mm256_permute2f128_ps(b[i], b[i + 4], 0x20);
    rows[i + 4] = _mm256_permute2f128_ps(b[i], b[i + 4], 0x31);
  }
}

GSFW_FUNCTION void transpose(Pack<float>* packs) {
  // Each quarter of the square by itself; the two off the diagonal change places.
  __m256 upper_left[8], upper_right[8], lower_left[8], lower_right[8];
  for (int i = 0; i < 8; ++i) {
    upper_left[i] = packs[i].low;
    upper_right[i] = packs[i].high;
    lower_left[i] = packs[i + 8].low;
    lower_right[i] = packs[i + 8].high;
  }
  transpose(upper_left);
  transpose(upper_right);
  transpose(lower_left);
  transpose(lower_right);
  for (int i = 0; i < 8; ++i) {
    packs[i] = {upper_left[i], lower_left[i]};
    packs[i + 8] = {upper_right[i], lower_right[i]};
  }
}

GSFW_FUNCTION __m256 power_of_two(__m256 a) {
  // Adding 1.5 * 2^23 rounds to an integer, whose low bits are then the mantissa's.
  const __m256 shift = _mm256_set1_ps(12582912.0f);
  const __m256 x = _mm256_max_ps(a, _mm256_set1_ps(LEAST_EXPONENT));
  const __m256 shifted = _mm256_add_ps(x, shift);
  const __m256 f = _mm256_sub_ps(x, _mm256_sub_ps(shifted, shift));
  __m256 p = _mm256_set1_ps(POWER_OF_TWO[5]);
  p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(POWER_OF_TWO[4]));
  p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(POWER_OF_TWO[3]));
  p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(POWER_OF_TWO[2]));
  p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(POWER_OF_TWO[1]));
  p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(POWER_OF_TWO[0]));
  const __m256i exponent = _mm256_slli_epi32(_mm256_castps_si256(shifted), 23);
  return _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(p), exponent));
}

GSFW_FUNCTION Pack<float> power_of_two(Pack<float> a) {
  return {power_of_two(a.low), power_of_two(a.high)};
}

/// For each set of eight lanes, the bytes that move those lanes of 16 bits to the front.
struct CompressTable {
  uint8_t bytes[256][16];

  constexpr CompressTable() : bytes() {
    for (int set = 0; set < 256; ++set) {
      int length = 0;
      for (int lane = 0; lane < 8; ++lane) {
        if (!(set >> lane & 1)) continue;
        bytes[set][length++] = uint8_t(2 * lane);
        bytes[set][length++] = uint8_t(2 * lane + 1);
      }
    }
  }
};

alignas(64) constexpr CompressTable COMPRESS{};

GSFW_FUNCTION __m256i bit_ranges(__m256 first, __m256 end) {
  const __m256i one = _mm256_set1_epi32(1);
  return _mm256_sub_epi32(_mm256_sllv_epi32(one, _mm256_cvttps_epi32(end)),
                          _mm256_sllv_epi32(one, _mm256_cvttps_epi32(first)));
}

GSFW_FUNCTION void bit_ranges(Pack<float> first, Pack<float> end, uint16_t* to) {
  // Packing works in halves of registers; the permutation puts their quarters in order.
  const __m256i both = _mm256_packus_epi32(bit_ranges(first.low, end.low),
                                           bit_ranges(first.high, end.high));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm256_permute4x64_epi64(both, 0xd8));
}

GSFW_FUNCTION int keep_nonzero(const uint16_t* numbers, const uint32_t* labels, uint32_t base,
                               uint16_t* to, uint32_t* to_labels) {
  int count = 0;
  for (int i = 0; i < LANES; i += 8) {
    const __m128i eight = _mm_loadu_si128(reinterpret_cast<const __m128i*>(numbers + i));
    const __m128i none = _mm_cmpeq_epi16(eight, _mm_setzero_si128());
    const int there = ~_mm_movemask_epi8(_mm_packs_epi16(none, none)) & 255;
    const __m128i order = _mm_load_si128(reinterpret_cast<const __m128i*>(COMPRESS.bytes[there]));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(to + count), _mm_shuffle_epi8(eight, order));
    // A pair of bytes 2 k, 2 k + 1 moves lane k, whose number is in bits 1 to 3.
    const __m256i lanes = _mm256_srli_epi32(_mm256_cvtepu16_epi32(order), 1);
    const __m256i label = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(labels + i));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to_labels + count),
                        _mm256_add_epi32(_mm256_permutevar8x32_epi32(label, lanes),
                                         _mm256_set1_epi32(int(base))));
    count += __builtin_popcount(uint32_t(there));
  }
  return count;
}

GSFW_FUNCTION void split_by_bit(const uint32_t* blocks, int count, uint16_t* lists, int capacity,
                                int* lengths) {
  for (int b = 0; b < LANES; ++b) {
    uint16_t* list = lists + b * capacity;
    int length = 0;
    __m128i index = _mm_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7);
    const __m128i to_sign = _mm_cvtsi32_si128(31 - b);
    for (int i = 0; i < count; i += 8) {
      const __m256i there = _mm256_castps_si256(first_lanes<float>(count - i).low);
      const __m256i eight =
          _mm256_maskload_epi32(reinterpret_cast<const int*>(blocks + i), there);
      const int hit = _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_sll_epi32(eight, to_sign)));
      const __m128i order = _mm_load_si128(reinterpret_cast<const __m128i*>(COMPRESS.bytes[hit]));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(list + length), _mm_shuffle_epi8(index, order));
      length += __builtin_popcount(uint32_t(hit));
      index = _mm_add_epi16(index, _mm_set1_epi16(8));
    }
    lengths[b] = length;
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
