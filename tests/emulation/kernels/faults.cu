// Faults: kernels that the emulation must refuse to run to their end.
#include "arrays.h"

namespace gsfw {
namespace cuda {

/// Lanes from ``count`` on return before their warp meets.
__global__ void __launch_bounds__(ARRAY_THREADS) early_return(ArrayJob job) {
  if (lane_index() >= job.count) return;
  written<int>(job, thread_index()) = __shfl_xor_sync(FULL_WARP, 1, 1);
}

/// Half of a warp is at the block's barrier while the other half waits for it.
__global__ void __launch_bounds__(ARRAY_THREADS) divergent_barrier(ArrayJob job) {
  if (threadIdx.x < job.count) {
    __syncthreads();
  } else {
    __syncwarp();
  }
}

/// Half of a warp votes while the other half exchanges.
__global__ void __launch_bounds__(ARRAY_THREADS) different_collectives(ArrayJob job) {
  if (lane_index() < 16) {
    __ballot_sync(FULL_WARP, 1);
  } else {
    __shfl_sync(FULL_WARP, int(job.count), 0);
  }
}

/// Threads of a block count at a barrier where others do not.
__global__ void __launch_bounds__(ARRAY_THREADS) different_barriers(ArrayJob job) {
  if (threadIdx.x < job.count) {
    __syncthreads();
  } else {
    __syncthreads_count(1);
  }
}

/// A collective of a part of the warp.
__global__ void __launch_bounds__(ARRAY_THREADS) half_warp(ArrayJob job) {
  if (lane_index() < 16) written<int>(job, thread_index()) = __shfl_sync(0xffffu, 1, 0);
}

/// Needs ``count`` bytes of its stack.
__device__ __noinline__ int use_stack(int64 bytes) {
  volatile char* const memory = static_cast<volatile char*>(__builtin_alloca(uint64(bytes)));
  for (int64 i = 0; i < bytes; ++i) memory[i] = 1;
  __syncthreads();
  return memory[bytes / 2];
}
__global__ void __launch_bounds__(ARRAY_THREADS) large_frame(ArrayJob job) {
  written<int>(job, thread_index()) = use_stack(job.count);
}

}  // namespace cuda
}  // namespace gsfw
