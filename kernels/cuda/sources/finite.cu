// Whether numbers are finite: one pass over memory.
#include "step_stages.h"

namespace gsfw {
namespace cuda {

/// Numbers that are read together: 16 bytes.
template <class T>
struct alignas(16) Pack {
  static constexpr int SIZE = 16 / int(sizeof(T));
  T at[SIZE];
};

/// Part of a block: numbers [from, to) of one tensor.
template <class T>
struct Span {
  const T* numbers;
  int64 from, to;
};

template <class T>
__device__ __forceinline__ Span<T> span_of_block(const FiniteJob& job) {
  const void* numbers = nullptr;
  int64 count = 0;
  int block = 0;
  // A search would index the job at run time, for which it would have to be copied.
#pragma unroll
  for (int i = 0; i < FINITE_TENSORS; ++i) {
    if (int(blockIdx.x) < job.first_blocks[i]) continue;
    numbers = job.numbers[i];
    count = job.counts[i];
    block = int(blockIdx.x) - job.first_blocks[i];
  }
  const int64 from = int64(block) * FINITE_NUMBERS, rest = count - from;
  return {static_cast<const T*>(numbers), from,
          from + (rest < FINITE_NUMBERS ? rest : FINITE_NUMBERS)};
}

/// See ``FiniteJob``. Every block has FINITE_THREADS and reads FINITE_NUMBERS numbers, or those
/// that are left of its tensor.
template <class T>
__global__ void __launch_bounds__(FINITE_THREADS) check_finite(FiniteJob job) {
  const Span<T> span = span_of_block<T>(job);
  // 0 x is 0 for finite x and NaN for others, and NaN stays in a sum.
  T sum = T(0.0);
  if (job.aligned && span.to - span.from == FINITE_NUMBERS) {
    const Pack<T>* packs = reinterpret_cast<const Pack<T>*>(span.numbers + span.from);
    constexpr int ROUNDS = FINITE_NUMBERS / (FINITE_THREADS * Pack<T>::SIZE);
#pragma unroll
    for (int i = 0; i < ROUNDS; ++i) {
      const Pack<T> pack = packs[i * FINITE_THREADS + int(threadIdx.x)];
#pragma unroll
      for (int k = 0; k < Pack<T>::SIZE; ++k) sum = fma(T(0.0), pack.at[k], sum);
    }
  } else {
    for (int64 i = span.from + threadIdx.x; i < span.to; i += FINITE_THREADS) {
      sum = fma(T(0.0), span.numbers[i], sum);
    }
  }
  // Whoever writes, writes the same.
  if (sum != T(0.0)) *job.finite = 0;
}

}  // namespace cuda
}  // namespace gsfw
