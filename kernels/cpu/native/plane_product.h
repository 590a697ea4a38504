// Products of the features of six planes at places, and their gradients.
//
// Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering", section 4.2: three
// planes of space, xy, xz and yz, are interpolated bilinearly, and three of space and time, read at
// one time beforehand, linearly; features are multiplied channel by channel. A task of the backward
// pass has sixteen channels of a level to itself and adds up rows in order, so that sums do not
// depend on the number of threads.
#pragma once

#include "field_stages.h"
#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

constexpr int PLANES = 3, FACTORS = 6;
/// Rows from a row to the one whose place and gradient are fetched with it: they lie apart.
constexpr int64_t AHEAD = 8;
/// Axes of plane p.
constexpr int FIRST_AXIS[PLANES] = {0, 0, 1}, SECOND_AXIS[PLANES] = {1, 2, 2};

/// A cell along one axis, the weights of its two corners, and the cells per unit of the coordinate.
template <typename T>
struct Cell {
  int64_t at;
  T low, high, slope;
};

template <typename T>
GSFW_FUNCTION Cell<T> cell_of(T coordinate, int64_t side) {
  // NaN counts as -1: it may be no index. Beyond the border values are constant.
  const bool inside = coordinate >= T(-1) && coordinate <= T(1);
  const T x = coordinate > T(-1) ? (coordinate < T(1) ? coordinate : T(1)) : T(-1);
  const T half = T(side - 1) / T(2), place = (x + T(1)) * half;
  int64_t at = int64_t(place);
  if (at > side - 2) at = side - 2;
  const T high = place - T(at);
  return {at, T(1) - high, high, inside ? half : T(0)};
}

/// Where the corners of one row's cells lie in the planes and lines of a level.
template <typename T>
struct Corners {
  Cell<T> cells[PLANES];
  int64_t plane_at[PLANES], line_at[PLANES];
  int64_t next_row, channels;

  GSFW_FUNCTION Corners(const T* place, int64_t side, int64_t width)
      : next_row(side * width), channels(width) {
    for (int k = 0; k < PLANES; ++k) cells[k] = cell_of(place[k], side);
    for (int k = 0; k < PLANES; ++k) {
      const int64_t row = k * side + cells[FIRST_AXIS[k]].at;
      plane_at[k] = (row * side + cells[SECOND_AXIS[k]].at) * width;
      line_at[k] = (k * side + cells[k].at) * width;
    }
  }
};

/// An interpolated factor of sixteen channels and its derivatives by the cell's coordinates.
template <typename T>
struct PlaneValue {
  Pack<T> value, by_first, by_second;
};

template <typename T>
GSFW_FUNCTION PlaneValue<T> plane_value(const Corners<T>& at, const T* planes, int k, int64_t c) {
  const Cell<T>&first = at.cells[FIRST_AXIS[k]], &second = at.cells[SECOND_AXIS[k]];
  const T* const from = planes + at.plane_at[k] + c;
  const Pack<T> a = load(from), b = load(from + at.channels);
  const Pack<T> d = load(from + at.next_row), e = load(from + at.next_row + at.channels);
  const Pack<T> low(second.low), high(second.high), near(first.low), far(first.high);
  const Pack<T> above = fma(high, b, low * a), below = fma(high, e, low * d);
  return {fma(far, below, near * above), below - above, fma(far, e - d, near * (b - a))};
}

template <typename T>
struct LineValue {
  Pack<T> value, slope;
};

template <typename T>
GSFW_FUNCTION LineValue<T> line_value(const Corners<T>& at, const T* lines, int k, int64_t c) {
  const T* const from = lines + at.line_at[k] + c;
  const Pack<T> a = load(from), b = load(from + at.channels);
  return {fma(Pack<T>(at.cells[k].high), b, Pack<T>(at.cells[k].low) * a), b - a};
}

/// Features [n, levels * channels] of places [begin, end).
template <typename T>
void plane_product(const PlaneProductJob<T>& job, int64_t begin, int64_t end, T* features) {
  const int64_t width = job.channels;
  for (int64_t row = begin; row < end; ++row) {
    T* to = features + row * job.level_count * width;
    for (int64_t i = 0; i < job.level_count; ++i, to += width) {
      const PlaneLevel<T>& level = job.levels[i];
      const Corners<T> at(job.places + row * PLANES, level.side, width);
      for (int64_t c = 0; c < width; c += LANES) {
        Pack<T> product(job.scale);
        for (int k = 0; k < PLANES; ++k) {
          product = product * (plane_value(at, level.planes, k, c).value *
                               line_value(at, level.lines, k, c).value);
        }
        store(to + c, product);
      }
    }
  }
}

/// Gradients of the six factors of sixteen channels: each is ``gradient`` times the other five.
template <typename T>
GSFW_FUNCTION void factor_gradients(const Pack<T>& gradient, const PlaneValue<T>* planes,
                                    const LineValue<T>* lines, Pack<T>* to) {
  const Pack<T> pairs[PLANES] = {planes[0].value * lines[0].value, planes[1].value * lines[1].value,
                                 planes[2].value * lines[2].value};
  const Pack<T> others[PLANES] = {gradient * (pairs[1] * pairs[2]),
                                  gradient * (pairs[0] * pairs[2]),
                                  gradient * (pairs[0] * pairs[1])};
  for (int k = 0; k < PLANES; ++k) {
    to[k] = others[k] * lines[k].value;
    to[PLANES + k] = others[k] * planes[k].value;
  }
}

template <typename T>
GSFW_FUNCTION void add_scaled(T weight, const Pack<T>& gradient, T* to) {
  store(to, fma(Pack<T>(weight), gradient, load(to)));
}

/// Add the gradients of the six factors to their planes and lines.
template <typename T>
GSFW_FUNCTION void scatter(const PlaneLevel<T>& level, const Corners<T>& at, int64_t channel,
                           const Pack<T>* flows) {
  for (int k = 0; k < PLANES; ++k) {
    const Cell<T>&first = at.cells[FIRST_AXIS[k]], &second = at.cells[SECOND_AXIS[k]];
    T* const plane = level.planes_gradient + at.plane_at[k] + channel;
    add_scaled(first.low * second.low, flows[k], plane);
    add_scaled(first.low * second.high, flows[k], plane + at.channels);
    add_scaled(first.high * second.low, flows[k], plane + at.next_row);
    add_scaled(first.high * second.high, flows[k], plane + at.next_row + at.channels);
    T* const line = level.lines_gradient + at.line_at[k] + channel;
    add_scaled(at.cells[k].low, flows[PLANES + k], line);
    add_scaled(at.cells[k].high, flows[PLANES + k], line + at.channels);
  }
}

/// Gradients of the sixteen channels from ``channel`` on of a level, row by row in the order of
/// ``rows``; those of the places, as far as they follow from these channels, go to ``moved``.
template <typename T>
void plane_product_backward(const PlaneProductJob<T>& job, const FieldRows<T>& rows,
                            int64_t number, int64_t channel, T* moved) {
  const PlaneLevel<T>& level = job.levels[number];
  const int64_t features = job.level_count * job.channels;
  const T* const gradient = rows.gradient + number * job.channels + channel;
  for (int64_t entry = 0; entry < rows.count; ++entry, moved += PLANES) {
    const int64_t row = rows.rows[entry];
    if (entry + AHEAD < rows.count) {
      const int64_t later = rows.rows[entry + AHEAD];
      __builtin_prefetch(job.places + later * PLANES);
      __builtin_prefetch(gradient + later * features);
    }
    const Corners<T> at(job.places + row * PLANES, level.side, job.channels);
    PlaneValue<T> planes[PLANES];
    LineValue<T> lines[PLANES];
    for (int k = 0; k < PLANES; ++k) {
      planes[k] = plane_value(at, level.planes, k, channel);
      lines[k] = line_value(at, level.lines, k, channel);
    }
    Pack<T> flows[FACTORS];
    factor_gradients(load(gradient + row * features) * Pack<T>(job.scale), planes, lines, flows);
    const Pack<T> x = fma(flows[0], planes[0].by_first, flows[1] * planes[1].by_first);
    const Pack<T> y = fma(flows[0], planes[0].by_second, flows[2] * planes[2].by_first);
    const Pack<T> z = fma(flows[1], planes[1].by_second, flows[2] * planes[2].by_second);
    moved[0] = sum(fma(flows[3], lines[0].slope, x)) * at.cells[0].slope;
    moved[1] = sum(fma(flows[4], lines[1].slope, y)) * at.cells[1].slope;
    moved[2] = sum(fma(flows[5], lines[2].slope, z)) * at.cells[2].slope;
    scatter(level, at, channel, flows);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
