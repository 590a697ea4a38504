// Regularisers of grids with their gradients, in one pass over memory: squared differences of
// neighbouring cells, and distances from a constant. Fridovich-Keil et al. 2023 ("K-Planes"),
// section 3.2: total variation in space, smoothness and sparse transients in time.
#pragma once

#include "field_stages.h"
#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Sixteen numbers from ``from``, or those that are left.
template <typename T>
GSFW_FUNCTION Pack<T> some(const T* from, int64_t left) {
  return left >= LANES ? load(from) : load_strided(from, 1, left);
}

template <typename T>
GSFW_FUNCTION void put(T* to, int64_t left, const Pack<T>& value) {
  if (left >= LANES) return store(to, value);
  store_strided(to, 1, first_lanes<T>(left), value);
}

/// First differences along one axis around a cell: the sum of squares of the one after it, and
/// half the gradient of all squares.
template <typename T>
GSFW_FUNCTION Pack<T> first_differences(const T* cell, int64_t left, const GridAxis<T>& axis,
                                        int64_t at, Pack<T>* squares) {
  const Pack<T> here = some(cell, left);
  Pack<T> flow(0.0);
  if (at > 0) flow = here - some(cell - axis.stride, left);
  if (at + 1 < axis.cells) {
    const Pack<T> step = some(cell + axis.stride, left) - here;
    flow = flow - step;
    *squares = fma(Pack<T>(axis.weight), step * step, *squares);
  }
  return flow * Pack<T>(axis.weight);
}

/// Second difference from the cell ``steps`` before this one on; 0 where it would leave the grid.
template <typename T>
GSFW_FUNCTION Pack<T> second_difference(const T* cell, int64_t left, const GridAxis<T>& axis,
                                        int64_t at, int64_t steps) {
  if (at < steps || at - steps + 2 >= axis.cells) return Pack<T>(0.0);
  const T* const from = cell - steps * axis.stride;
  const Pack<T> middle = some(from + axis.stride, left);
  return (some(from + 2 * axis.stride, left) - middle) - (middle - some(from, left));
}

/// The same for second differences.
template <typename T>
GSFW_FUNCTION Pack<T> second_differences(const T* cell, int64_t left, const GridAxis<T>& axis,
                                         int64_t at, Pack<T>* squares) {
  const Pack<T> after = second_difference(cell, left, axis, at, 0);
  const Pack<T> around = second_difference(cell, left, axis, at, 1);
  const Pack<T> before = second_difference(cell, left, axis, at, 2);
  *squares = fma(Pack<T>(axis.weight), after * after, *squares);
  return ((after - around) - (around - before)) * Pack<T>(axis.weight);
}

/// Weighted sum of squared differences of the cells [begin, end) with those after them; the
/// gradient of the whole sum at these cells. A cell is ``inner`` numbers.
template <typename T>
double grid_variation(const GridVariationJob<T>& job, int64_t begin, int64_t end) {
  Pack<T> squares(0.0);
  double total = 0;
  for (int64_t cell = begin; cell < end; ++cell) {
    const int64_t second = cell % job.second.cells;
    const int64_t first = cell / job.second.cells % job.first.cells;
    for (int64_t c = 0; c < job.inner; c += LANES) {
      const T* const from = job.grid + cell * job.inner + c;
      const int64_t left = job.inner - c;
      Pack<T> flow(0.0);
      if (job.order == 1) {
        flow = first_differences(from, left, job.first, first, &squares);
        flow = flow + first_differences(from, left, job.second, second, &squares);
      } else {
        flow = second_differences(from, left, job.first, first, &squares);
      }
      if (job.gradient) put(job.gradient + cell * job.inner + c, left, flow + flow);
    }
    // A sum in T over a cell only: means over millions of numbers keep their digits.
    total += double(sum(squares));
    squares = Pack<T>(0.0);
  }
  return total;
}

/// Sum of |value - center| over [0, count); ``gradient`` receives ``weight`` times its sign.
template <typename T>
double grid_distance(const T* values, int64_t count, T center, T weight, T* gradient) {
  constexpr int64_t RUN = 64 * LANES;
  const Pack<T> from(center), up(weight), zero(0.0);
  double total = 0;
  for (int64_t start = 0; start < count; start += RUN) {
    const int64_t stop = count - start < RUN ? count : start + RUN;
    Pack<T> distances(0.0);
    for (int64_t i = start; i < stop; i += LANES) {
      const int64_t left = count - i;
      const LaneMask<T> there = first_lanes<T>(left);
      const Pack<T> difference = keep(there, some(values + i, left) - from);
      distances = distances + absolute(difference);
      const Pack<T> sign = keep(difference > zero, up) - keep(difference < zero, up);
      if (gradient) put(gradient + i, left, sign);
    }
    total += double(sum(distances));
  }
  return total;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
