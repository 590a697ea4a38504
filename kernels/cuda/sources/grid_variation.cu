// Regularisers of grids and their gradients: squared differences of neighbouring cells, and
// distances from a constant. Fridovich-Keil et al. 2023 ("K-Planes"), section 3.2: total variation
// in space, smoothness and sparse transients in time.
//
// The backward pass reads the grid again, so that the forward pass writes nothing but sums, whose
// order depends on the size of the grid only.
#include "field_stages.h"

#include "block_sum.h"

namespace gsfw {
namespace cuda {

/// Do ``visit(number)`` for this thread's numbers of the grid.
template <class F>
__device__ __forceinline__ void visit_numbers(const GridNumbers& grid, F&& visit) {
  const int64 from = int64(blockIdx.x) * GRID_NUMBERS, rest = grid.count - from;
  const int64 to = from + (rest < GRID_NUMBERS ? rest : GRID_NUMBERS);
  for (int64 i = from + threadIdx.x; i < to; i += GRID_THREADS) visit(i);
}

/// The block's part of a penalty, from that of each thread.
__device__ __forceinline__ void write_part(const GridNumbers& grid, double part) {
  const double parts[] = {part};
  write_block_sums<GRID_THREADS>(parts, grid.sums + blockIdx.x, 1);
}

/// A number of a grid and its neighbours along one axis.
template <class T>
struct Neighbours {
  const T* here;
  int at, cells, stride;

  __device__ __forceinline__ Neighbours(const T* grid, int64 number, const GridAxis& axis)
      : here(grid + number),
        at(int(uint32(number) / uint32(axis.stride) % uint32(axis.cells))),
        cells(axis.cells),
        stride(axis.stride) {}

  /// First difference from the cell ``before`` this one on; 0 where it would leave the grid.
  __device__ __forceinline__ T first_difference(int before) const {
    if (at < before || at - before + 1 >= cells) return T(0.0);
    const T* const from = here - int64(before) * stride;
    return from[stride] - from[0];
  }

  /// Second difference from the cell ``before`` this one on; 0 where it would leave the grid.
  __device__ __forceinline__ T second_difference(int before) const {
    if (at < before || at - before + 2 >= cells) return T(0.0);
    const T* const from = here - int64(before) * stride;
    return (from[2 * int64(stride)] - from[stride]) - (from[stride] - from[0]);
  }

  /// Half the gradient of all squared first, or second, differences.
  __device__ __forceinline__ T first_flow() const {
    return first_difference(1) - first_difference(0);
  }
  __device__ __forceinline__ T second_flow() const {
    const T around = second_difference(1);
    return (second_difference(0) - around) - (around - second_difference(2));
  }
};

/// See ``GridVariationJob``. Every block has GRID_THREADS and GRID_NUMBERS numbers, or those that
/// are left.
template <class T>
__global__ void __launch_bounds__(GRID_THREADS) grid_variation(GridVariationJob job) {
  const T* const grid = static_cast<const T*>(job.grid.values);
  T firsts = T(0.0), seconds = T(0.0);
  visit_numbers(job.grid, [&](int64 number) {
    const Neighbours<T> first(grid, number, job.first), second(grid, number, job.second);
    const T along = job.order == 1 ? first.first_difference(0) : first.second_difference(0);
    const T across = job.order == 1 ? second.first_difference(0) : T(0.0);
    firsts = fma(along, along, firsts);
    seconds = fma(across, across, seconds);
  });
  write_part(job.grid, job.first.weight * double(firsts) + job.second.weight * double(seconds));
}

/// See ``GridVariationJob``. Blocks as in the forward pass.
template <class T>
__global__ void __launch_bounds__(GRID_THREADS) grid_variation_backward(GridVariationJob job) {
  const T* const grid = static_cast<const T*>(job.grid.values);
  const T twice = T(2.0) * *static_cast<const T*>(job.grid.arriving);
  const T along = twice * T(job.first.weight), across = twice * T(job.second.weight);
  visit_numbers(job.grid, [&](int64 number) {
    const Neighbours<T> first(grid, number, job.first), second(grid, number, job.second);
    const T flow = job.order == 1 ? fma(along, first.first_flow(), across * second.first_flow())
                                  : along * first.second_flow();
    static_cast<T*>(job.grid.gradient)[number] = flow;
  });
}

/// See ``GridDistanceJob``. Blocks as in ``grid_variation``.
template <class T>
__global__ void __launch_bounds__(GRID_THREADS) grid_distance(GridDistanceJob job) {
  const T* const values = static_cast<const T*>(job.grid.values);
  const T center = T(job.center);
  T distances = T(0.0);
  visit_numbers(job.grid, [&](int64 number) { distances += absolute(values[number] - center); });
  write_part(job.grid, job.weight * double(distances));
}

/// See ``GridDistanceJob``. Blocks as in ``grid_variation``.
template <class T>
__global__ void __launch_bounds__(GRID_THREADS) grid_distance_backward(GridDistanceJob job) {
  const T* const values = static_cast<const T*>(job.grid.values);
  const T center = T(job.center), zero = T(0.0);
  const T up = T(job.weight) * *static_cast<const T*>(job.grid.arriving);
  visit_numbers(job.grid, [&](int64 number) {
    const T difference = values[number] - center;
    const T sign = difference > zero ? up : (difference < zero ? -up : zero);
    static_cast<T*>(job.grid.gradient)[number] = sign;
  });
}

/// See ``PenaltyJob``. One block of GRID_THREADS.
template <class T>
__global__ void __launch_bounds__(GRID_THREADS) add_penalty(PenaltyJob job) {
  __shared__ double total;
  double sums[] = {0.0};
  for (int64 block = threadIdx.x; block < job.blocks; block += GRID_THREADS) {
    sums[0] += job.sums[block];
  }
  write_block_sums<GRID_THREADS>(sums, &total, 1);
  if (threadIdx.x == 0) *static_cast<T*>(job.value) = T(total);
}

}  // namespace cuda
}  // namespace gsfw
