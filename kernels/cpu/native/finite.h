// Whether numbers are finite: one pass over memory.
#pragma once

#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Whether none of ``numbers`` [count] is infinite or NaN.
template <typename T>
bool all_finite(const T* numbers, int64_t count) {
  // x - x is 0 for finite x and NaN for others, and NaN stays in a sum.
  constexpr int CHAINS = 4;
  Pack<T> sums[CHAINS];
  for (int k = 0; k < CHAINS; ++k) sums[k] = Pack<T>(T(0));
  int64_t i = 0;
  for (; i + CHAINS * LANES <= count; i += CHAINS * LANES) {
    for (int k = 0; k < CHAINS; ++k) {
      const Pack<T> x = load(numbers + i + k * LANES);
      sums[k] = sums[k] + (x - x);
    }
  }
  for (; i < count; i += LANES) {
    const Pack<T> x = load_strided(numbers + i, 1, count - i);
    sums[0] = sums[0] + (x - x);
  }
  return sum((sums[0] + sums[1]) + (sums[2] + sums[3])) == T(0);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
