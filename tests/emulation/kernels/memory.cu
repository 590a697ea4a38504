// Memory: atomics, what memory holds, and where it ends.
#include "arrays.h"

namespace gsfw {
namespace cuda {

/// T [n] to T [5]: sum in global memory, sum by way of shared memory, greatest, least, and 1 plus
/// how many threads found that 0.
template <class T>
__global__ void __launch_bounds__(ARRAY_THREADS) gather(ArrayJob job) {
  __shared__ T sum;
  if (threadIdx.x == 0) sum = T(0);
  __syncthreads();
  const T value = read<T>(job, thread_index());
  atomicAdd(&written<T>(job, 0), value);
  atomicAdd(&sum, value);
  atomicMax(&written<T>(job, 2), value);
  atomicMin(&written<T>(job, 3), value);
  if (atomicCAS(&written<T>(job, 4), 0, 1) == T(0)) atomicAdd(&written<T>(job, 4), 1);
  __syncthreads();
  if (threadIdx.x == 0) atomicAdd(&written<T>(job, 1), sum);
}

/// uint32 [n] to uint32 [3]: or, and, exclusive or.
__global__ void __launch_bounds__(ARRAY_THREADS) combine(ArrayJob job) {
  const uint32 value = read<uint32>(job, thread_index());
  atomicOr(&written<uint32>(job, 0), value);
  atomicAnd(&written<uint32>(job, 1), value);
  atomicXor(&written<uint32>(job, 2), value);
}

/// float [n] to float [1]: a sum whose last bits are those of the order.
__global__ void __launch_bounds__(ARRAY_THREADS) add_in_any_order(ArrayJob job) {
  atomicAdd(&written<float>(job, 0), read<float>(job, thread_index()));
}

/// uint32 [n] to int [n, 4]: bits that are set, the first and the leading zeros; all reversed.
__global__ void __launch_bounds__(ARRAY_THREADS) count_bits(ArrayJob job) {
  const int64 index = thread_index();
  const uint32 value = read<uint32>(job, index);
  int* const row = &written<int>(job, 4 * index);
  row[0] = __popc(value);
  row[1] = __ffs(int(value));
  row[2] = __clz(int(value));
  row[3] = int(__brev(value));
}

/// What shared memory holds before a block writes to it, for a block that then writes zeros.
template <class T>
__global__ void __launch_bounds__(ARRAY_THREADS) leftovers(ArrayJob job) {
  __shared__ T values[ARRAY_THREADS];
  written<T>(job, thread_index()) = values[threadIdx.x];
  values[threadIdx.x] = T(0);
}

/// int64 [blocks, threads]: rows that are ``count`` apart.
__global__ void __launch_bounds__(ARRAY_THREADS) far_apart(ArrayJob job) {
  written<int64>(job, thread_index()) = int64(blockIdx.x) * job.count + threadIdx.x;
}

/// Four numbers at once, from ``count`` floats behind the input's beginning.
__global__ void __launch_bounds__(ARRAY_THREADS) copy_fours(ArrayJob job) {
  const float* const from = &static_cast<const float*>(job.input)[job.count];
  const float4 four = reinterpret_cast<const float4*>(from)[thread_index()];
  static_cast<float4*>(job.output)[thread_index()] = make_float4(four.w, four.z, four.y, four.x);
}

/// What is at ``index`` of shared memory that this function has for itself.
template <class T>
__device__ __noinline__ T look(int64 index) {
  __shared__ T values[ARRAY_THREADS];
  values[threadIdx.x] = T(1);
  __syncthreads();
  return values[index];
}

/// Whatever is at ``count`` of shared memory, which has one number per thread.
__global__ void __launch_bounds__(ARRAY_THREADS) look_around(ArrayJob job) {
  __shared__ float values[ARRAY_THREADS];
  values[threadIdx.x] = 1.0f;
  __syncthreads();
  if (threadIdx.x == 0) written<float>(job, 0) = values[job.count];
}
__global__ void __launch_bounds__(ARRAY_THREADS) look_within(ArrayJob job) {
  const float found = look<float>(job.count);
  if (threadIdx.x == 0) written<float>(job, 0) = found;
}

}  // namespace cuda
}  // namespace gsfw
