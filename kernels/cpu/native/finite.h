// Whether numbers are finite: one pass over memory.
#pragma once

#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Whether none of ``numbers`` [count] is infinite or NaN.
template <typename T>
bool all_finite(const T* numbers, int64_t count) {
  // x - x is 0 for finite x and NaN for others, and NaN stays in a sum. Four runs are read at once,
  // because the processor reads ahead in each of them.
  constexpr int RUNS = 4;
  const int64_t run = count / RUNS / LANES * LANES;
  Pack<T> sums[RUNS];
  for (int k = 0; k < RUNS; ++k) sums[k] = Pack<T>(T(0));
  for (int64_t i = 0; i < run; i += LANES) {
    for (int k = 0; k < RUNS; ++k) {
      const Pack<T> x = load(numbers + k * run + i);
      sums[k] = sums[k] + (x - x);
    }
  }
  for (int64_t i = RUNS * run; i < count; i += LANES) {
    const Pack<T> x = load_strided(numbers + i, 1, count - i);
    sums[0] = sums[0] + (x - x);
  }
  return sum((sums[0] + sums[1]) + (sums[2] + sums[3])) == T(0);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
