// Sums over a block, in an order that depends on its number of threads only.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

/// The sums over the block, in double after those over each warp: sum i goes to
/// ``to[i * distance]``. A collective of all THREADS threads.
template <int THREADS, class T, int COUNT>
__device__ __forceinline__ void write_block_sums(const T (&sums)[COUNT], double* to,
                                                 int64 distance) {
  constexpr int WARPS = THREADS / WARP;
  __shared__ T of_warps[COUNT * WARPS];
#pragma unroll
  for (int i = 0; i < COUNT; ++i) {
    const T sum = warp_sum(sums[i]);
    if (lane_index() == 0) of_warps[i * WARPS + warp_index()] = sum;
  }
  __syncthreads();
  const int mine = int(threadIdx.x);
  if (mine >= COUNT) return;
  double total = 0.0;
  for (int warp = 0; warp < WARPS; ++warp) total += double(of_warps[mine * WARPS + warp]);
  to[mine * distance] = total;
}

}  // namespace cuda
}  // namespace gsfw
