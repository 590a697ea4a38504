// Platform: what every kernel relies on beyond the shared mathematics.
//
// The same text is compiled by NVRTC, without any standard header, and by a C++ compiler together
// with the emulation that the tests run kernels on. That emulation knows full warps only: every
// collective has the mask FULL_WARP and is reached by all lanes, or by none.
#pragma once

#ifndef GSFW_ISA
#define GSFW_ISA cuda
#endif

#include "number.h"

namespace gsfw {
namespace cuda {

using int8 = signed char;
using uint8 = unsigned char;
using uint16 = unsigned short;
using uint32 = unsigned int;
using int64 = long long;
using uint64 = unsigned long long;

constexpr int WARP = 32;
constexpr uint32 FULL_WARP = 0xffffffffu;

/// Four numbers that are read or written at once.
template <class T>
struct __align__(16) Four {
  T numbers[4];
};

/// Position of this thread in its warp, and of its warp in the block. Blocks are one-dimensional.
__device__ __forceinline__ int lane_index() { return int(threadIdx.x) % WARP; }
__device__ __forceinline__ int warp_index() { return int(threadIdx.x) / WARP; }

/// This thread among all of the grid.
__device__ __forceinline__ int64 thread_index() {
  return int64(blockIdx.x) * blockDim.x + threadIdx.x;
}

/// Bits of the lanes before this one.
__device__ __forceinline__ uint32 lanes_before() { return (1u << lane_index()) - 1u; }

/// The sum over the warp, in every lane, always added in the same order.
template <class N>
__device__ __forceinline__ N warp_sum(N value) {
  for (int offset = WARP / 2; offset > 0; offset /= 2) {
    value += __shfl_xor_sync(FULL_WARP, value, offset);
  }
  return value;
}

/// The sum of this lane's value and of those of all lanes before it.
template <class N>
__device__ __forceinline__ N warp_running_sum(N value) {
  for (int offset = 1; offset < WARP; offset *= 2) {
    const N before = __shfl_up_sync(FULL_WARP, value, offset);
    if (lane_index() >= offset) value += before;
  }
  return value;
}

/// Number of elements of a job. Where the host does not know it, ``counted`` has it, of which there
/// is room for ``count``.
template <class Job>
__device__ __forceinline__ int64 count_of(const Job& job) {
  return job.counted && *job.counted < job.count ? *job.counted : job.count;
}

/// The smaller and the greater of two numbers, one instruction each; of a number and a NaN, the
/// number.
__device__ __forceinline__ float least(float a, float b) { return GSFW_ELEMENTARY(fminf)(a, b); }
__device__ __forceinline__ double least(double a, double b) { return GSFW_ELEMENTARY(fmin)(a, b); }
__device__ __forceinline__ float greatest(float a, float b) { return GSFW_ELEMENTARY(fmaxf)(a, b); }
__device__ __forceinline__ double greatest(double a, double b) {
  return GSFW_ELEMENTARY(fmax)(a, b);
}

/// 2 to the power of x; results below the least normal number count as 0.
__device__ __forceinline__ float power_of_two(float x) {
#ifdef __CUDA_ARCH__
  // One instruction, right to 2 units in the last place; exp2f would add a rescaling for subnormal
  // results, which no pixel can show.
  float result;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(x));
  return result;
#else
  return GSFW_ELEMENTARY(exp2f)(x);
#endif
}
__device__ __forceinline__ double power_of_two(double x) { return GSFW_ELEMENTARY(exp2)(x); }

/// The binary logarithm, to full precision.
__device__ __forceinline__ float logarithm_of_two(float x) { return GSFW_ELEMENTARY(log2f)(x); }
__device__ __forceinline__ double logarithm_of_two(double x) { return GSFW_ELEMENTARY(log2)(x); }

}  // namespace cuda
}  // namespace gsfw
