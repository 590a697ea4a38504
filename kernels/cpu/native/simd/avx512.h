// Packs of float in one AVX-512 register each. Needs F, VL, DQ and BW.
#pragma once

#include <immintrin.h>

namespace gsfw {
namespace GSFW_ISA {

template <>
struct LaneMask<float> {
  __mmask16 bits;

  GSFW_FUNCTION LaneMask() {}
  GSFW_FUNCTION explicit LaneMask(__mmask16 lanes) : bits(lanes) {}

  GSFW_FUNCTION friend LaneMask operator&(LaneMask a, LaneMask b) {
    return LaneMask(_kand_mask16(a.bits, b.bits));
  }
  GSFW_FUNCTION friend LaneMask operator|(LaneMask a, LaneMask b) {
    return LaneMask(_kor_mask16(a.bits, b.bits));
  }
  GSFW_FUNCTION friend LaneMask operator!(LaneMask a) { return LaneMask(_knot_mask16(a.bits)); }
};

template <>
struct Pack<float> {
  __m512 v;

  GSFW_FUNCTION Pack() {}
  GSFW_FUNCTION Pack(double value) : v(_mm512_set1_ps(float(value))) {}
  GSFW_FUNCTION Pack(__m512 value) : v(value) {}

  GSFW_FUNCTION friend Pack operator+(Pack a, Pack b) { return _mm512_add_ps(a.v, b.v); }
  GSFW_FUNCTION friend Pack operator-(Pack a, Pack b) { return _mm512_sub_ps(a.v, b.v); }
  GSFW_FUNCTION friend Pack operator*(Pack a, Pack b) { return _mm512_mul_ps(a.v, b.v); }
  GSFW_FUNCTION friend Pack operator/(Pack a, Pack b) { return _mm512_div_ps(a.v, b.v); }
  GSFW_FUNCTION friend Pack operator-(Pack a) {
    return _mm512_xor_ps(a.v, _mm512_set1_ps(-0.0f));
  }
  GSFW_FUNCTION friend LaneMask<float> operator<(Pack a, Pack b) {
    return LaneMask<float>(_mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ));
  }
  GSFW_FUNCTION friend LaneMask<float> operator<=(Pack a, Pack b) {
    return LaneMask<float>(_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ));
  }
  GSFW_FUNCTION friend LaneMask<float> operator>(Pack a, Pack b) { return b < a; }
  GSFW_FUNCTION friend LaneMask<float> operator>=(Pack a, Pack b) { return b <= a; }
};

GSFW_FUNCTION uint32_t bits_of(LaneMask<float> mask) { return mask.bits; }

GSFW_FUNCTION bool any(LaneMask<float> mask) { return mask.bits != 0; }

template <>
GSFW_FUNCTION LaneMask<float> lanes_of<float>(uint32_t bits) {
  return LaneMask<float>(__mmask16(bits));
}

template <>
GSFW_FUNCTION LaneMask<float> first_lanes<float>(int64_t count) {
  return LaneMask<float>(__mmask16(count >= LANES ? 0xffffu : (1u << count) - 1u));
}

GSFW_FUNCTION Pack<float> load(const float* from) { return _mm512_loadu_ps(from); }

GSFW_FUNCTION void store(float* to, Pack<float> a) { _mm512_storeu_ps(to, a.v); }

GSFW_FUNCTION __m512i strides(int64_t stride) {
  const __m512i lanes =
      _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  return _mm512_mullo_epi32(lanes, _mm512_set1_epi32(int(stride)));
}

GSFW_FUNCTION Pack<float> load_strided(const float* from, int64_t stride, int64_t count) {
  const __mmask16 mask = first_lanes<float>(count).bits;
  if (stride == 1) return _mm512_maskz_loadu_ps(mask, from);
  return _mm512_mask_i32gather_ps(_mm512_setzero_ps(), mask, strides(stride), from, 4);
}

/// Index ``step`` lanes apart, from ``first`` on, for a permutation of two registers; what lies
/// beyond them is taken from a third one later.
GSFW_FUNCTION __m512i every(int step, int first) {
  return _mm512_add_epi32(strides(step), _mm512_set1_epi32(first));
}

template <int FIELDS>
GSFW_FUNCTION void load_rows(const float* from, int64_t count, Pack<float>* fields) {
  static_assert(FIELDS == 3 || FIELDS == 4, "two permutations reach as far as four registers");
  __m512 read[4] = {};
  for (int k = 0; k < FIELDS; ++k) {
    const int64_t left = FIELDS * count - k * LANES;
    const __mmask16 mask = left > 0 ? first_lanes<float>(left).bits : 0;
    read[k] = _mm512_maskz_loadu_ps(mask, from + k * LANES);
  }
  for (int k = 0; k < FIELDS; ++k) {
    // Lane i is number FIELDS i + k, and lies in the first two registers while that is below 32.
    const __m512i index = every(FIELDS, k);
    const __m512 low = _mm512_permutex2var_ps(read[0], index, read[1]);
    const __m512 high = _mm512_permutex2var_ps(read[2], index, read[3]);
    const __mmask16 beyond = _mm512_cmpge_epi32_mask(index, _mm512_set1_epi32(2 * LANES));
    fields[k] = _mm512_mask_mov_ps(low, beyond, high);
  }
}

GSFW_FUNCTION void store_strided(float* to, int64_t stride, LaneMask<float> mask, Pack<float> a) {
  if (stride == 1) {
    _mm512_mask_storeu_ps(to, mask.bits, a.v);
  } else {
    _mm512_mask_i32scatter_ps(to, mask.bits, strides(stride), a.v, 4);
  }
}

/// For number 16 k + i of rows of ``FIELDS`` numbers: its row, plus 16 where its field is odd,
/// which picks it from a pair of fields; and whether that is the second pair.
template <int FIELDS>
struct Interleave {
  alignas(64) int32_t index[FIELDS][LANES];
  uint16_t second[FIELDS];

  constexpr Interleave() : index(), second() {
    for (int k = 0; k < FIELDS; ++k) {
      for (int i = 0; i < LANES; ++i) {
        const int number = k * LANES + i, field = number % FIELDS;
        index[k][i] = number / FIELDS + field % 2 * LANES;
        second[k] = uint16_t(second[k] | (field / 2) << i);
      }
    }
  }
};

template <int FIELDS>
GSFW_FUNCTION void store_rows(float* to, int64_t count, const Pack<float>* fields) {
  static_assert(FIELDS == 3 || FIELDS == 4, "two pairs of fields");
  static constexpr Interleave<FIELDS> table{};
  for (int k = 0; k < FIELDS; ++k) {
    const __m512i index = _mm512_load_si512(table.index[k]);
    const __m512 first = _mm512_permutex2var_ps(fields[0].v, index, fields[1].v);
    const __m512 second = _mm512_permutex2var_ps(fields[2].v, index, fields[FIELDS - 1].v);
    const int64_t left = FIELDS * count - k * LANES;
    const __mmask16 mask = left > 0 ? first_lanes<float>(left).bits : 0;
    _mm512_mask_storeu_ps(to + k * LANES, mask,
                          _mm512_mask_mov_ps(first, table.second[k], second));
  }
}

GSFW_FUNCTION Pack<float> select(LaneMask<float> mask, Pack<float> a, Pack<float> b) {
  return _mm512_mask_mov_ps(b.v, mask.bits, a.v);
}

GSFW_FUNCTION Pack<float> keep(LaneMask<float> mask, Pack<float> a) {
  return _mm512_maskz_mov_ps(mask.bits, a.v);
}

GSFW_FUNCTION Pack<float> square_root(Pack<float> a) { return _mm512_sqrt_ps(a.v); }

GSFW_FUNCTION Pack<float> absolute(Pack<float> a) { return _mm512_abs_ps(a.v); }

GSFW_FUNCTION Pack<float> round_down(Pack<float> a) {
  return _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
}

GSFW_FUNCTION Pack<float> logarithm_of_two(Pack<float> a) {
  alignas(64) float lanes[LANES];
  _mm512_store_ps(lanes, a.v);
  for (int i = 0; i < LANES; ++i) lanes[i] = GSFW_ELEMENTARY(log2f)(lanes[i]);
  return _mm512_load_ps(lanes);
}

GSFW_FUNCTION Pack<float> arc_tangent(Pack<float> a) {
  alignas(64) float lanes[LANES];
  _mm512_store_ps(lanes, a.v);
  for (int i = 0; i < LANES; ++i) lanes[i] = arc_tangent(lanes[i]);
  return _mm512_load_ps(lanes);
}

GSFW_FUNCTION Pack<float> minimum(Pack<float> a, Pack<float> b) { return _mm512_min_ps(a.v, b.v); }

GSFW_FUNCTION Pack<float> maximum(Pack<float> a, Pack<float> b) { return _mm512_max_ps(a.v, b.v); }

GSFW_FUNCTION Pack<float> fma(Pack<float> a, Pack<float> b, Pack<float> c) {
  return _mm512_fmadd_ps(a.v, b.v, c.v);
}

GSFW_FUNCTION Pack<float> fma_negated(Pack<float> a, Pack<float> b, Pack<float> c) {
  return _mm512_fnmadd_ps(a.v, b.v, c.v);
}

GSFW_FUNCTION float sum(Pack<float> a) {
  const __m256 half = _mm256_add_ps(_mm512_castps512_ps256(a.v), _mm512_extractf32x8_ps(a.v, 1));
  const __m128 quarter = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));
  const __m128 pair = _mm_add_ps(quarter, _mm_movehl_ps(quarter, quarter));
  return _mm_cvtss_f32(_mm_add_ss(pair, _mm_movehdup_ps(pair)));
}

GSFW_FUNCTION void sum_eight(const Pack<float>* packs, float* to) {
  // Each level adds the halves of two registers into one, until lane i holds the sum of pack i.
  __m256 halves[8];
  for (int i = 0; i < 8; ++i) {
    halves[i] =
        _mm256_add_ps(_mm512_castps512_ps256(packs[i].v), _mm512_extractf32x8_ps(packs[i].v, 1));
  }
  const __m256 a = _mm256_hadd_ps(halves[0], halves[1]), b = _mm256_hadd_ps(halves[2], halves[3]);
  const __m256 c = _mm256_hadd_ps(halves[4], halves[5]), d = _mm256_hadd_ps(halves[6], halves[7]);
  const __m256 e = _mm256_hadd_ps(a, b), f = _mm256_hadd_ps(c, d);
  const __m256 low = _mm256_permute2f128_ps(e, f, 0x20), high = _mm256_permute2f128_ps(e, f, 0x31);
  _mm256_storeu_ps(to, _mm256_add_ps(low, high));
}

GSFW_FUNCTION void transpose(Pack<float>* packs) {
  // Pairs of rows, then pairs of pairs, then quarters of registers: 4 lanes, 16 lanes, all.
  __m512 a[LANES], b[LANES];
  for (int i = 0; i < LANES; i += 2) {
    a[i] = _mm512_unpacklo_ps(packs[i].v, packs[i + 1].v);
    a[i + 1] = _mm512_unpackhi_ps(packs[i].v, packs[i + 1].v);
  }
  for (int i = 0; i < LANES; i += 4) {
    b[i] = _mm512_shuffle_ps(a[i], a[i + 2], 0x44);
    b[i + 1] = _mm512_shuffle_ps(a[i], a[i + 2], 0xee);
    b[i + 2] = _mm512_shuffle_ps(a[i + 1], a[i + 3], 0x44);
    b[i + 3] = _mm512_shuffle_ps(a[i + 1], a[i + 3], 0xee);
  }
  for (int i = 0; i < 4; ++i) {
    const __m512 even_low = _mm512_shuffle_f32x4(b[i], b[i + 4], 0x88);
    const __m512 odd_low = _mm512_shuffle_f32x4(b[i], b[i + 4], 0xdd);
    const __m512 even_high = _mm512_shuffle_f32x4(b[i + 8], b[i + 12], 0x88);
    const __m512 odd_high = _mm512_shuffle_f32x4(b[i + 8], b[i + 12], 0xdd);
    packs[i] = _mm512_shuffle_f32x4(even_low, even_high, 0x88);
    packs[i + 4] = _mm512_shuffle_f32x4(odd_low, odd_high, 0x88);
    packs[i + 8] = _mm512_shuffle_f32x4(even_low, even_high, 0xdd);
    packs[i + 12] = _mm512_shuffle_f32x4(odd_low, odd_high, 0xdd);
  }
}

GSFW_FUNCTION Pack<float> power_of_two(Pack<float> a) {
  const __m512 whole = _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
  const __m512 f = _mm512_sub_ps(a.v, whole);
  __m512 p = _mm512_set1_ps(POWER_OF_TWO[5]);
  p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(POWER_OF_TWO[4]));
  p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(POWER_OF_TWO[3]));
  p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(POWER_OF_TWO[2]));
  p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(POWER_OF_TWO[1]));
  p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(POWER_OF_TWO[0]));
  return _mm512_scalef_ps(p, whole);
}

GSFW_FUNCTION void bit_ranges(Pack<float> first, Pack<float> end, uint16_t* to) {
  const __m512i one = _mm512_set1_epi32(1);
  const __m512i bits =
      _mm512_sub_epi32(_mm512_sllv_epi32(one, _mm512_cvttps_epi32(end.v)),
                       _mm512_sllv_epi32(one, _mm512_cvttps_epi32(first.v)));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm512_cvtepi32_epi16(bits));
}

GSFW_FUNCTION int keep_nonzero(const uint16_t* numbers, const uint32_t* labels, uint32_t base,
                               uint16_t* to, uint32_t* to_labels) {
  const __m512i all = _mm512_cvtepu16_epi32(
      _mm256_loadu_si256(reinterpret_cast<const __m256i*>(numbers)));
  const __mmask16 there = _mm512_test_epi32_mask(all, all);
  const __m512i label =
      _mm512_add_epi32(_mm512_loadu_si512(labels), _mm512_set1_epi32(int(base)));
  const __m512i kept = _mm512_maskz_compress_epi32(there, all);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm512_cvtepi32_epi16(kept));
  _mm512_storeu_si512(to_labels, _mm512_maskz_compress_epi32(there, label));
  return __builtin_popcount(there);
}

GSFW_FUNCTION void split_by_bit(const uint32_t* blocks, int count, uint16_t* lists, int capacity,
                                int* lengths) {
  for (int b = 0; b < LANES; ++b) {
    uint16_t* list = lists + b * capacity;
    int length = 0;
    __m512i index = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m512i bit = _mm512_set1_epi32(1 << b);
    for (int i = 0; i < count; i += LANES) {
      const __mmask16 there = first_lanes<float>(count - i).bits;
      const __mmask16 hit = _mm512_mask_test_epi32_mask(
          there, _mm512_maskz_loadu_epi32(there, blocks + i), bit);
      // Into a register and then stored whole: compressing into memory is microcode on some CPUs.
      const __m512i kept = _mm512_maskz_compress_epi32(hit, index);
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(list + length), _mm512_cvtepi32_epi16(kept));
      length += __builtin_popcount(hit);
      index = _mm512_add_epi32(index, _mm512_set1_epi32(LANES));
    }
    lengths[b] = length;
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
