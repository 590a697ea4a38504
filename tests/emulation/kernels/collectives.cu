// Collectives: what each of them gives every thread.
#include "arrays.h"

namespace gsfw {
namespace cuda {

/// T [n] to T [n, 6]: exchanges with a lane of the thread's choice (what the number says), with one
/// for all, with those before, after and across, and the sum of the warp.
template <class T>
__global__ void __launch_bounds__(ARRAY_THREADS) exchange(ArrayJob job) {
  const int64 index = thread_index();
  const T value = read<T>(job, index);
  T* const row = &written<T>(job, 6 * index);
  row[0] = __shfl_sync(FULL_WARP, value, int(value));
  row[1] = __shfl_sync(FULL_WARP, value, 5);
  row[2] = __shfl_up_sync(FULL_WARP, value, 3);
  row[3] = __shfl_down_sync(FULL_WARP, value, 7);
  row[4] = __shfl_xor_sync(FULL_WARP, value, 9);
  row[5] = warp_sum(value);
}

/// int [n] to uint32 [n, 3]: which lanes, whether any, and whether all of the warp have no zero.
__global__ void __launch_bounds__(ARRAY_THREADS) vote(ArrayJob job) {
  const int64 index = thread_index();
  const int value = read<int>(job, index);
  uint32* const row = &written<uint32>(job, 3 * index);
  row[0] = __ballot_sync(FULL_WARP, value);
  row[1] = uint32(__any_sync(FULL_WARP, value));
  row[2] = uint32(__all_sync(FULL_WARP, value));
}

/// int [n] to int [n, 3]: how many, whether any, and whether all of the block have no zero.
__global__ void __launch_bounds__(ARRAY_THREADS) count(ArrayJob job) {
  const int64 index = thread_index();
  const int value = read<int>(job, index);
  int* const row = &written<int>(job, 3 * index);
  row[0] = __syncthreads_count(value);
  row[1] = __syncthreads_or(value);
  row[2] = __syncthreads_and(value);
}

/// T [n] to T [blocks]: sums, by warps and then over them.
template <class T>
__global__ void __launch_bounds__(ARRAY_THREADS) block_sums(ArrayJob job) {
  __shared__ T sums[ARRAY_THREADS / WARP];
  const int64 index = thread_index();
  const T sum = warp_sum(index < job.count ? read<T>(job, index) : T(0));
  if (lane_index() == 0) sums[warp_index()] = sum;
  __syncthreads();
  if (threadIdx.x != 0) return;
  T total = T(0);
  for (int warp = 0; warp < ARRAY_THREADS / WARP; ++warp) total += sums[warp];
  written<T>(job, blockIdx.x) = total;
}

/// int [n] to int [n], each block from back to front; wrong where it does not synchronise.
template <bool SYNCHRONISES>
__global__ void __launch_bounds__(ARRAY_THREADS) reverse(ArrayJob job) {
  __shared__ int values[ARRAY_THREADS];
  const int64 index = thread_index();
  values[threadIdx.x] = read<int>(job, index);
  if (SYNCHRONISES) __syncthreads();
  written<int>(job, index) = values[blockDim.x - 1 - threadIdx.x];
}

/// int [n] to int [n]: rotates each warp ``count`` times; wrong where it does not synchronise
/// between reading and writing.
template <bool SYNCHRONISES>
__global__ void __launch_bounds__(ARRAY_THREADS) rotate(ArrayJob job) {
  __shared__ int values[ARRAY_THREADS];
  const int64 index = thread_index();
  const int next = warp_index() * WARP + (lane_index() + 1) % WARP;
  int value = read<int>(job, index);
  for (int64 i = 0; i < job.count; ++i) {
    values[threadIdx.x] = value;
    __syncwarp();
    value = values[next];
    if (SYNCHRONISES) __syncwarp();
  }
  written<int>(job, index) = value;
}

}  // namespace cuda
}  // namespace gsfw
