// Features of a multi-resolution hash grid in place and time, and the gradients of its tables.
//
// Mueller et al. 2022, "Instant Neural Graphics Primitives", section 3, in four dimensions: rows of
// a table are interpolated linearly among the sixteen corners of a cell. Corners have rows of their
// own where the table is large enough, and share them by a hash (equation 4) elsewhere. A task of
// the backward pass has a level to itself and adds up rows in order.
#pragma once

#include "field_stages.h"
#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

constexpr int HASH_AXES = 4;

/// The cell of a coordinate in [0, 1] among ``corners`` corners; NaN counts as 0.
template <typename T>
GSFW_FUNCTION void cell_between(T coordinate, int64_t corners, int64_t* low, T* weight) {
  const T x = coordinate > T(0) ? (coordinate < T(1) ? coordinate : T(1)) : T(0);
  const T place = x * T(corners - 1);
  *low = int64_t(place);
  if (*low > corners - 2) *low = corners - 2;
  *weight = place - T(*low);
}

/// Parts of rows and weights of the four corners along two axes.
template <typename T>
struct CornerPairs {
  uint64_t rows[4];
  T weights[4];
};

/// Corners along axes with these cells; ``DENSE`` adds the parts of rows, a hash combines bits.
template <bool DENSE, typename T>
GSFW_FUNCTION CornerPairs<T> corner_pairs(const int64_t* low, const T* high,
                                          const uint64_t* factors) {
  const uint64_t a = uint64_t(low[0]) * factors[0], b = uint64_t(low[1]) * factors[1];
  const uint64_t c = a + factors[0], d = b + factors[1];
  const T e = T(1) - high[0], f = T(1) - high[1];
  CornerPairs<T> pairs = {{}, {e * f, high[0] * f, e * high[1], high[0] * high[1]}};
  const uint64_t firsts[4] = {a, c, a, c}, seconds[4] = {b, b, d, d};
  for (int k = 0; k < 4; ++k) {
    pairs.rows[k] = DENSE ? firsts[k] + seconds[k] : firsts[k] ^ seconds[k];
  }
  return pairs;
}

/// Do ``visit(row, weight)`` for the sixteen corners around a place.
template <bool DENSE, typename T, typename F>
GSFW_FUNCTION void visit_corners(const HashLevel<T>& level, const T* place, T time, F&& visit) {
  int64_t low[HASH_AXES];
  T high[HASH_AXES];
  for (int axis = 0; axis < 3; ++axis) {
    cell_between((place[axis] + T(1)) / T(2), level.side, low + axis, high + axis);
  }
  cell_between(time, level.times, low + 3, high + 3);
  const CornerPairs<T> near = corner_pairs<DENSE, T>(low, high, level.factors);
  const CornerPairs<T> far = corner_pairs<DENSE, T>(low + 2, high + 2, level.factors + 2);
  const uint64_t mask = uint64_t(level.rows - 1);
  for (int j = 0; j < 4; ++j) {
    for (int k = 0; k < 4; ++k) {
      const uint64_t row =
          DENSE ? far.rows[j] + near.rows[k] : (far.rows[j] ^ near.rows[k]) & mask;
      visit(row, far.weights[j] * near.weights[k]);
    }
  }
}

/// Features of one level; ``WIDTH`` is 0 where the channels are known at run time only.
template <bool DENSE, int WIDTH, typename T>
GSFW_FUNCTION void read_level(const HashJob<T>& job, int64_t number, int64_t row, T* to) {
  const HashLevel<T>& level = job.levels[number];
  const int64_t width = WIDTH ? WIDTH : job.channels;
  T sums[WIDTH ? WIDTH : 1] = {};
  T* const sum = WIDTH ? sums : to;
  for (int64_t c = 0; c < width; ++c) sum[c] = T(0);
  visit_corners<DENSE>(level, job.places + 3 * row, job.time, [&](uint64_t at, T weight) {
    const T* const from = level.table + at * uint64_t(width);
    for (int64_t c = 0; c < width; ++c) sum[c] = sum[c] + weight * from[c];
  });
  for (int64_t c = 0; WIDTH && c < width; ++c) to[c] = sum[c];
}

template <int WIDTH, typename T>
GSFW_FUNCTION void read_levels(const HashJob<T>& job, int64_t begin, int64_t end, T* features) {
  for (int64_t row = begin; row < end; ++row) {
    T* to = features + row * job.level_count * job.channels;
    for (int64_t i = 0; i < job.level_count; ++i, to += job.channels) {
      if (job.levels[i].dense) {
        read_level<true, WIDTH>(job, i, row, to);
      } else {
        read_level<false, WIDTH>(job, i, row, to);
      }
    }
  }
}

/// Features [n, levels * channels] of places [begin, end).
template <typename T>
void hash_features(const HashJob<T>& job, int64_t begin, int64_t end, T* features) {
  if (job.channels == 2) return read_levels<2>(job, begin, end, features);
  if (job.channels == 4) return read_levels<4>(job, begin, end, features);
  read_levels<0>(job, begin, end, features);
}

/// Add the gradients of the features to one table, row by row.
template <bool DENSE, int WIDTH, typename T>
GSFW_FUNCTION void write_level(const HashJob<T>& job, const FieldRows<T>& rows, int64_t number) {
  const HashLevel<T>& level = job.levels[number];
  const int64_t width = WIDTH ? WIDTH : job.channels;
  for (int64_t entry = 0; entry < rows.count; ++entry) {
    const int64_t row = rows.rows[entry];
    const T* const given = rows.gradient + (row * job.level_count + number) * width;
    T flows[WIDTH ? WIDTH : 1] = {};
    for (int64_t c = 0; WIDTH && c < width; ++c) flows[c] = given[c];
    const T* const flow = WIDTH ? flows : given;
    visit_corners<DENSE>(level, job.places + 3 * row, job.time, [&](uint64_t at, T weight) {
      T* const to = level.gradient + at * uint64_t(width);
      for (int64_t c = 0; c < width; ++c) to[c] = to[c] + weight * flow[c];
    });
  }
}

template <int WIDTH, typename T>
GSFW_FUNCTION void write_either(const HashJob<T>& job, const FieldRows<T>& rows, int64_t number) {
  if (job.levels[number].dense) return write_level<true, WIDTH>(job, rows, number);
  write_level<false, WIDTH>(job, rows, number);
}

/// Gradients of the table of level ``number``.
template <typename T>
void hash_features_backward(const HashJob<T>& job, const FieldRows<T>& rows, int64_t number) {
  if (job.channels == 2) return write_either<2>(job, rows, number);
  if (job.channels == 4) return write_either<4>(job, rows, number);
  write_either<0>(job, rows, number);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
