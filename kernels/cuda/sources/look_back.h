// Look-back: sums over all earlier blocks, within one launch (Merrill and Garland 2016, "Single-pass
// Parallel Prefix Scan with Decoupled Look-back").
//
// A block takes its number when it starts. All blocks with lower numbers have started then, and
// none of them waits for a later one, so that they end. Each tells the others its own sum, and then
// the sum up to its end. A sum and what it is share one word, which is written at once: no fence is
// needed. Words are 0 before the kernel.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

/// What a word holds: nothing yet, the sum of its block, or the sum of its block and of all before.
enum SumKind { NO_SUM, OWN_SUM, RUNNING_SUM };

constexpr int SUM_BITS = 56;

__device__ __forceinline__ int kind_of(uint64 word) { return int(word >> SUM_BITS); }
__device__ __forceinline__ int64 sum_of(uint64 word) {
  return int64(word & ((uint64(1) << SUM_BITS) - 1));
}

__device__ __forceinline__ void tell_sum(uint64* word, int kind, int64 sum) {
  atomicExch(word, uint64(kind) << SUM_BITS | uint64(sum));
}

/// The word, as soon as it is of the kind or of a higher one.
__device__ __forceinline__ uint64 await_sum(const uint64* word, int kind) {
  uint64 found = *static_cast<const volatile uint64*>(word);
  while (kind_of(found) < kind) found = *static_cast<const volatile uint64*>(word);
  return found;
}

/// The number of this block. All threads call it, once in a kernel.
__device__ __forceinline__ int take_number(uint64* next) {
  __shared__ int number;
  if (threadIdx.x == 0) number = int(atomicAdd(next, uint64(1)));
  __syncthreads();
  return number;
}

/// Sums over a block of threads: of those before this one, and of all.
template <class N>
struct BlockSum {
  N before, all;
};

/// All threads call it; a kernel that does so again brings them together in between.
template <int THREADS, class N>
__device__ __forceinline__ BlockSum<N> block_sum(N value) {
  __shared__ N sums[THREADS / WARP];
  const N running = warp_running_sum(value);
  if (lane_index() == WARP - 1) sums[warp_index()] = running;
  __syncthreads();
  BlockSum<N> sum{running - value, N(0)};
#pragma unroll
  for (int w = 0; w < THREADS / WARP; ++w) {
    if (w < warp_index()) sum.before += sums[w];
    sum.all += sums[w];
  }
  return sum;
}

/// The sum over all blocks before number ``block``; a warp looks back at 32 of them at once. A warp
/// collective.
__device__ __forceinline__ int64 look_back(uint64* words, int block, int64 own) {
  if (lane_index() == 0) tell_sum(words + block, OWN_SUM, own);
  int64 sum = 0;
  for (int last = block - 1; last >= 0; last -= WARP) {
    const int other = last - lane_index();
    const uint64 word =
        other < 0 ? uint64(RUNNING_SUM) << SUM_BITS : await_sum(words + other, OWN_SUM);
    const uint32 running = __ballot_sync(FULL_WARP, kind_of(word) == RUNNING_SUM);
    const int nearest = running == 0 ? WARP - 1 : __ffs(int(running)) - 1;
    sum += warp_sum(lane_index() <= nearest ? sum_of(word) : int64(0));
    if (running != 0) break;
  }
  if (lane_index() == 0) tell_sum(words + block, RUNNING_SUM, sum + own);
  return sum;
}

/// The same for a whole block of threads, all of which call it, once in a kernel.
__device__ __forceinline__ int64 sum_before_block(uint64* words, int block, int64 own) {
  __shared__ int64 before;
  if (warp_index() == 0) {
    const int64 sum = look_back(words, block, own);
    if (lane_index() == 0) before = sum;
  }
  __syncthreads();
  return before;
}

}  // namespace cuda
}  // namespace gsfw
