// Coefficients: spherical harmonics of a warp's rows, by way of shared memory.
//
// A row of degree 3 has 192 bytes of float: if each thread read its own, every load would touch 32
// lines of memory. Here the warp copies all of its rows, neighbouring threads neighbouring numbers,
// and each thread then finds its own row in shared memory. Gradients take the same backward pass.
#pragma once

#include "stages.h"

#include "spherical_harmonics.h"

namespace gsfw {
namespace cuda {

/// The rows that the threads of a warp have, one each.
struct WarpRows {
  int64 first;
  /// Bits of the lanes whose row is there, and of those whose row is visible.
  uint32 inside, visible;
};

/// The rows of this warp, of which this thread has ``row``. Reached by all lanes.
__device__ __forceinline__ WarpRows rows_of_warp(int64 row, bool inside, bool visible) {
  return {row - lane_index(), __ballot_sync(FULL_WARP, int(inside)),
          __ballot_sync(FULL_WARP, int(visible))};
}

/// In shared memory, one per warp: coefficient k of channel c is number 3 k + c of its row.
template <class T, int DEGREE>
struct Coefficients {
  static constexpr int NUMBERS = 3 * num_coefficients(DEGREE);

  /// The length of rows is odd, which spreads a column over all banks.
  T rows[WARP][NUMBERS | 1];
};

/// Copy ``COUNT`` numbers of each visible row of an array [n, stride] into shared memory, from
/// number ``FIRST`` on; zeros for the other rows.
template <int FIRST, int COUNT, class T, int DEGREE>
__device__ __forceinline__ void fetch_numbers(const void* array, int stride, const WarpRows& rows,
                                              Coefficients<T, DEGREE>& to) {
  const T* from = static_cast<const T*>(array) + rows.first * stride;
  // Unrolled, so that many loads are on their way at once.
#pragma unroll 8
  for (int i = 0; i < COUNT; ++i) {
    const int place = i * WARP + lane_index(), row = place / COUNT, k = place % COUNT;
    to.rows[row][FIRST + k] = rows.visible >> row & 1 ? from[row * stride + k] : T(0);
  }
}

/// Write such numbers back to an array [n, stride], or add them.
template <int FIRST, int COUNT, class T, int DEGREE>
__device__ __forceinline__ void give_numbers(const Coefficients<T, DEGREE>& from,
                                             const WarpRows& rows, bool add, int stride,
                                             void* array) {
  T* to = static_cast<T*>(array) + rows.first * stride;
  const uint32 written = add ? rows.visible : rows.inside;
#pragma unroll 8
  for (int i = 0; i < COUNT; ++i) {
    const int place = i * WARP + lane_index(), row = place / COUNT, k = place % COUNT;
    if (!(written >> row & 1)) continue;
    const T number = from.rows[row][FIRST + k];
    to[row * stride + k] = add ? to[row * stride + k] + number : number;
  }
}

/// Zero each row of an array [n, stride] from number ``first`` on.
template <class T>
__device__ __forceinline__ void clear_numbers(int first, const WarpRows& rows, int stride,
                                              void* array) {
  T* to = static_cast<T*>(array) + rows.first * stride;
  const int count = stride - first;
  for (int place = lane_index(); place < WARP * count; place += WARP) {
    const int row = place / count, k = first + place % count;
    if (rows.inside >> row & 1) to[row * stride + k] = T(0);
  }
}

/// Range of this lane's row in a ragged array [m, 3]; empty for lanes without a row.
struct RaggedRow {
  int64 begin, length;

  /// Those of another lane's row. Reached by all lanes.
  __device__ __forceinline__ RaggedRow of_lane(int lane) const {
    return {__shfl_sync(FULL_WARP, begin, lane), __shfl_sync(FULL_WARP, length, lane)};
  }
};

/// Whatever the offsets are, no row reaches beyond the array.
__device__ __forceinline__ RaggedRow ragged_row(const SplatArrays& splats, const WarpRows& rows) {
  if (!(rows.inside >> lane_index() & 1)) return {0, 0};
  const int64* offsets = splats.offsets + rows.first + lane_index();
  const int64 most = splats.rest_rows, first = offsets[0], last = offsets[1];
  const int64 begin = first < 0 ? 0 : first < most ? first : most;
  const int64 end = last < begin ? begin : last < most ? last : most;
  return {3 * begin, 3 * (end - begin)};
}

/// ``fetch_numbers`` of a ragged array: what a row does not have is zero, and not read.
template <int FIRST, int COUNT, class T, int DEGREE>
__device__ __forceinline__ void fetch_ragged(const void* array, const RaggedRow& own,
                                             const WarpRows& rows,
                                             Coefficients<T, DEGREE>& to) {
  const T* from = static_cast<const T*>(array);
#pragma unroll 8
  for (int i = 0; i < COUNT; ++i) {
    const int place = i * WARP + lane_index(), row = place / COUNT, k = place % COUNT;
    const RaggedRow lies = own.of_lane(row);
    const bool there = (rows.visible >> row & 1) && k < lies.length;
    to.rows[row][FIRST + k] = there ? from[lies.begin + k] : T(0);
  }
}

/// ``give_numbers`` to a ragged array, and zeros to what rows have beyond them.
template <int FIRST, int COUNT, class T, int DEGREE>
__device__ __forceinline__ void give_ragged(const Coefficients<T, DEGREE>& from,
                                            const RaggedRow& own, const WarpRows& rows, bool add,
                                            void* array) {
  T* to = static_cast<T*>(array);
  const uint32 written = add ? rows.visible : rows.inside;
#pragma unroll 8
  for (int i = 0; i < COUNT; ++i) {
    const int place = i * WARP + lane_index(), row = place / COUNT, k = place % COUNT;
    const RaggedRow lies = own.of_lane(row);
    if (!(written >> row & 1) || k >= lies.length) continue;
    const T number = from.rows[row][FIRST + k];
    to[lies.begin + k] = add ? to[lies.begin + k] + number : number;
  }
  for (int64 k = COUNT; k < own.length && !add; ++k) to[own.begin + k] = T(0);
}

/// Fetch the coefficients of the active degree. Reached by all lanes.
template <bool RAGGED, class T, int DEGREE>
__device__ __forceinline__ void fetch(const SplatArrays& splats, const WarpRows& rows,
                                      Coefficients<T, DEGREE>& to) {
  constexpr int NUMBERS = Coefficients<T, DEGREE>::NUMBERS;
  if constexpr (RAGGED) {
    fetch_numbers<0, 3>(splats.colors, splats.color_stride, rows, to);
    fetch_ragged<3, NUMBERS - 3>(splats.rest, ragged_row(splats, rows), rows, to);
  } else if (splats.rest) {
    fetch_numbers<0, 3>(splats.colors, splats.color_stride, rows, to);
    if constexpr (DEGREE > 0) {
      fetch_numbers<3, NUMBERS - 3>(splats.rest, splats.rest_stride, rows, to);
    }
  } else {
    fetch_numbers<0, NUMBERS>(splats.colors, splats.color_stride, rows, to);
  }
  __syncwarp(FULL_WARP);
}

/// Write the coefficients' gradients, which have taken their places; zeros beyond the active
/// degree. Reached by all lanes.
template <bool RAGGED, class T, int DEGREE>
__device__ __forceinline__ void give(const Coefficients<T, DEGREE>& from, const WarpRows& rows,
                                     bool add, const SplatArrays& splats,
                                     const SplatGradients& to) {
  constexpr int NUMBERS = Coefficients<T, DEGREE>::NUMBERS;
  __syncwarp(FULL_WARP);
  if constexpr (RAGGED) {
    if (to.colors) give_numbers<0, 3>(from, rows, add, splats.color_stride, to.colors);
    if (!to.rest) return;
    give_ragged<3, NUMBERS - 3>(from, ragged_row(splats, rows), rows, add, to.rest);
  } else if (splats.rest) {
    if (to.colors) give_numbers<0, 3>(from, rows, add, splats.color_stride, to.colors);
    if (!to.rest) return;
    if constexpr (DEGREE > 0) {
      give_numbers<3, NUMBERS - 3>(from, rows, add, splats.rest_stride, to.rest);
    }
    if (!add) clear_numbers<T>(NUMBERS - 3, rows, splats.rest_stride, to.rest);
  } else if (to.colors) {
    give_numbers<0, NUMBERS>(from, rows, add, splats.color_stride, to.colors);
    if (!add) clear_numbers<T>(NUMBERS, rows, splats.color_stride, to.colors);
  }
}

/// Sums of coefficient times basis of one row: the colours before their clamp.
template <int DEGREE, class T>
GSFW_FUNCTION Vector3<T> sum_bands(const T* row, const T* basis) {
  Vector3<T> sum{basis[0] * row[0], basis[0] * row[1], basis[0] * row[2]};
#pragma unroll
  for (int k = 1; k < num_coefficients(DEGREE); ++k) {
    sum = fma(basis[k], Vector3<T>{row[3 * k], row[3 * k + 1], row[3 * k + 2]}, sum);
  }
  return sum;
}

/// The gradient of ``sum_bands`` from that of the sums: by the coefficients into their places, and
/// by the basis into its.
template <int DEGREE, class T>
GSFW_FUNCTION void sum_bands_vjp(const Vector3<T>& by_sum, T* row, T* basis) {
#pragma unroll
  for (int k = 0; k < num_coefficients(DEGREE); ++k) {
    T* coefficient = row + 3 * k;
    const Vector3<T> gradient = basis[k] * by_sum;
    basis[k] = dot(by_sum, Vector3<T>{coefficient[0], coefficient[1], coefficient[2]});
    coefficient[0] = gradient.x;
    coefficient[1] = gradient.y;
    coefficient[2] = gradient.z;
  }
}

}  // namespace cuda
}  // namespace gsfw
