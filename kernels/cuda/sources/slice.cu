// Slices of Gaussians of space and time and their gradients: one thread per Gaussian.
#include "field_stages.h"

#include "slices.h"

namespace gsfw {
namespace cuda {

template <class T, int COUNT>
__device__ __forceinline__ void read_row(const void* rows, int64 row, T (&to)[COUNT]) {
#pragma unroll
  for (int k = 0; k < COUNT; ++k) to[k] = static_cast<const T*>(rows)[row * COUNT + k];
}

template <class T, int COUNT>
__device__ __forceinline__ void write_row(const T (&from)[COUNT], int64 row, void* rows) {
#pragma unroll
  for (int k = 0; k < COUNT; ++k) static_cast<T*>(rows)[row * COUNT + k] = from[k];
}

template <class T>
__device__ __forceinline__ Slice<T> slice_row(const SliceJob& job, int64 row) {
  SpaceTime<T> of;
  read_row(job.left, row, of.left);
  read_row(job.right, row, of.right);
  read_row(job.scales, row, of.scales);
  return Slice<T>(of);
}

/// See ``SliceJob``. Blocks of SLICE_THREADS, one thread per row.
template <class T>
__global__ void __launch_bounds__(SLICE_THREADS) slice(SliceJob job) {
  const int64 row = thread_index();
  if (row >= job.count) return;
  const Slice<T> of = slice_row<T>(job, row);
  T covariance[COVARIANCE_ENTRIES], velocity[SPACE_AXES];
#pragma unroll
  for (int a = 0; a < SPACE_AXES; ++a) {
    velocity[a] = of.velocity(a);
#pragma unroll
    for (int b = 0; b <= a; ++b) {
      covariance[SPACE_AXES * a + b] = covariance[SPACE_AXES * b + a] = of.covariance(a, b);
    }
  }
  write_row(covariance, row, job.covariances);
  write_row(velocity, row, job.velocities);
  static_cast<T*>(job.variances)[row] = of.variance;
}

/// See ``SliceBackwardJob``. Blocks as in the forward pass.
template <class T>
__global__ void __launch_bounds__(SLICE_THREADS) slice_backward(SliceBackwardJob job) {
  const int64 row = thread_index();
  if (row >= job.forward.count) return;
  const Slice<T> of = slice_row<T>(job.forward, row);
  SliceFlows<T> flows(static_cast<const T*>(job.variances)[row]);
  T covariance[COVARIANCE_ENTRIES], velocity[SPACE_AXES];
  read_row(job.covariances, row, covariance);
  read_row(job.velocities, row, velocity);
#pragma unroll
  for (int a = 0; a < SPACE_AXES; ++a) flows.add_velocity(of, a, velocity[a]);
#pragma unroll
  for (int a = 0; a < SPACE_AXES; ++a) {
    T symmetric[SPACE_AXES];
#pragma unroll
    for (int b = 0; b < SPACE_AXES; ++b) {
      symmetric[b] = covariance[SPACE_AXES * a + b] + covariance[SPACE_AXES * b + a];
    }
    flows.add_covariance(of, a, symmetric);
  }
  const SpaceTime<T> to = flows.finish(of);
  write_row(to.left, row, job.left);
  write_row(to.right, row, job.right);
  write_row(to.scales, row, job.scales);
}

}  // namespace cuda
}  // namespace gsfw
