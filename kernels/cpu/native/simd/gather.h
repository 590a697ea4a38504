// Loads of sixteen squares of pixels from sixteen places, for the sets that gather.
#pragma once

#include "simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Byte k of the words at ``index`` is written to ``bytes[k]``, as numbers up to 255. Indices are
/// whole, at least 0 and below 2^24.
GSFW_FUNCTION void gather_bytes(const uint32_t* from, Pack<float> index, Pack<float>* bytes) {
#if defined(GSFW_SIMD_avx512)
  const __m512i words = _mm512_i32gather_epi32(_mm512_cvttps_epi32(index.v), from, 4);
  const __m512i low = _mm512_set1_epi32(255);
  bytes[0] = _mm512_cvtepi32_ps(_mm512_and_si512(words, low));
  bytes[1] = _mm512_cvtepi32_ps(_mm512_and_si512(_mm512_srli_epi32(words, 8), low));
  bytes[2] = _mm512_cvtepi32_ps(_mm512_and_si512(_mm512_srli_epi32(words, 16), low));
  bytes[3] = _mm512_cvtepi32_ps(_mm512_srli_epi32(words, 24));
#elif defined(GSFW_SIMD_avx2)
  const int* const base = reinterpret_cast<const int*>(from);
  const __m256i low = _mm256_set1_epi32(255);
  const __m256i a = _mm256_i32gather_epi32(base, _mm256_cvttps_epi32(index.low), 4);
  const __m256i b = _mm256_i32gather_epi32(base, _mm256_cvttps_epi32(index.high), 4);
  for (int k = 0; k < 4; ++k) {
    bytes[k] = {_mm256_cvtepi32_ps(_mm256_and_si256(_mm256_srli_epi32(a, 8 * k), low)),
                _mm256_cvtepi32_ps(_mm256_and_si256(_mm256_srli_epi32(b, 8 * k), low))};
  }
#else
  float places[LANES], found[4][LANES];
  store(places, index);
  for (int i = 0; i < LANES; ++i) {
    const uint32_t word = from[int64_t(places[i])];
    for (int k = 0; k < 4; ++k) found[k][i] = float(word >> (8 * k) & 255u);
  }
  for (int k = 0; k < 4; ++k) bytes[k] = load(found[k]);
#endif
}

}  // namespace GSFW_ISA
}  // namespace gsfw
