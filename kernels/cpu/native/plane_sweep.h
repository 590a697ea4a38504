// Plane sweep: how well the neighbours' images fit the reference camera's at each depth of a set.
//
// For each depth the neighbours are warped to the reference camera and compared in a window (Collins
// 1996, "A Space-Sweep Approach to True Multi-Image Matching"). The cost of a pixel is the mean of
// its two best neighbours, as others may not see the place (Kang et al. 2001).
#pragma once

#include <string.h>

#include "simd/gather.h"
#include "stereo_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Differences of grey above this count as this: what is hidden is no worse than wrong.
constexpr double LARGEST_DIFFERENCE = 0.25;
/// Part of the cost that is the difference of the pixel; the rest is 1 - correlation.
constexpr double DIFFERENCE_SHARE = 0.4;
/// Windows with less variance are taken to have this: noise correlates with nothing.
constexpr double LEAST_VARIANCE = 1e-4;
/// Rows of sums that a window spans.
constexpr int64_t WINDOW = 2 * SWEEP_REACH + 1;
/// Sums of a window that change with the neighbour: its values, their squares, and products.
constexpr int64_t SUMS = 3;

/// Where the rows of one image's sweep lie in memory.
struct SweepRows {
  /// Numbers of a row, a multiple of 16, and of one with room for a window at both ends.
  int64_t length, padded;
  /// [height, length]: means and inverse deviations of the reference's windows.
  float* mean;
  float* deviation;
  /// [height, length]: the least and the second least cost at this plane.
  float* least;
  float* second;
  /// [WINDOW, SUMS, length]: sums along the rows that a window spans.
  float* sums;
  /// [WINDOW, length]: costs of single pixels, 1 where the neighbour does not see the place.
  float* differences;
  /// Room for one row of the reference and one warped, [padded] each.
  float* reference;
  float* warped;

  SweepRows(const SweepJob& job, float* scratch) {
    length = (job.width + LANES - 1) / LANES * LANES;
    padded = length + 2 * LANES;
    const int64_t image = job.height * length;
    mean = scratch;
    deviation = mean + image;
    least = deviation + image;
    second = least + image;
    sums = second + image;
    differences = sums + WINDOW * SUMS * length;
    reference = differences + WINDOW * length;
    warped = reference + padded;
  }

  static int64_t size(const SweepJob& job) {
    const int64_t length = (job.width + LANES - 1) / LANES * LANES;
    return 4 * job.height * length + WINDOW * (SUMS + 1) * length + 2 * (length + 2 * LANES);
  }
};

inline int64_t sweep_scratch(const SweepJob& job) { return SweepRows::size(job); }

/// Repeat the first and the last of ``width`` numbers from ``row + LANES`` on, as far as windows
/// and packs reach.
inline void extend_row(float* row, int64_t width, int64_t length) {
  float* const first = row + LANES;
  for (int64_t i = 1; i <= SWEEP_REACH; ++i) first[-i] = first[0];
  const int64_t end = length + SWEEP_REACH;
  for (int64_t x = width; x < end; ++x) first[x] = first[width - 1];
}

/// Sums over the rows of a window around row ``y``, each of which is ``stride`` long in a ring.
GSFW_FUNCTION Pack<float> window_sum(const float* sums, int64_t y, int64_t height, int64_t stride) {
  Pack<float> total(0.0);
  for (int64_t dy = -SWEEP_REACH; dy <= SWEEP_REACH; ++dy) {
    const int64_t at = y + dy < 0 ? 0 : y + dy >= height ? height - 1 : y + dy;
    total = total + load(sums + at % WINDOW * stride);
  }
  return total;
}

/// Sums along a row: of its values, their squares, and their products with the reference's.
inline void sum_row(const SweepRows& rows, int64_t y, const float* values) {
  float* const to = rows.sums + y % WINDOW * SUMS * rows.length;
  for (int64_t x = 0; x < rows.length; x += LANES) {
    Pack<float> sum(0.0), squares(0.0), products(0.0);
    for (int64_t dx = -SWEEP_REACH; dx <= SWEEP_REACH; ++dx) {
      const Pack<float> here = load(values + LANES + x + dx);
      const Pack<float> there = load(rows.reference + LANES + x + dx);
      sum = sum + here;
      squares = fma(here, here, squares);
      products = fma(here, there, products);
    }
    store(to + x, sum);
    store(to + rows.length + x, squares);
    store(to + 2 * rows.length + x, products);
  }
}

inline void take_reference_row(const SweepJob& job, const SweepRows& rows, int64_t y) {
  memcpy(rows.reference + LANES, job.image + y * job.width, job.width * sizeof(float));
  extend_row(rows.reference, job.width, rows.length);
}

/// Means and inverse deviations of the reference's own windows.
inline void describe_reference(const SweepJob& job, const SweepRows& rows) {
  const Pack<float> share(1.0 / (WINDOW * WINDOW)), floor(LEAST_VARIANCE), one(1.0);
  const int64_t stride = SUMS * rows.length;
  for (int64_t next = 0; next < job.height + SWEEP_REACH; ++next) {
    if (next < job.height) {
      take_reference_row(job, rows, next);
      sum_row(rows, next, rows.reference);
    }
    const int64_t y = next - SWEEP_REACH;
    if (y < 0) continue;
    for (int64_t x = 0; x < rows.length; x += LANES) {
      const Pack<float> mean = window_sum(rows.sums + x, y, job.height, stride) * share;
      const Pack<float> squares =
          window_sum(rows.sums + rows.length + x, y, job.height, stride) * share;
      const Pack<float> variance = maximum(fma_negated(mean, mean, squares), floor);
      store(rows.mean + y * rows.length + x, mean);
      store(rows.deviation + y * rows.length + x, one / square_root(variance));
    }
  }
}

/// Row ``y`` of the reference as the neighbour shows it at the inverse depth ``q``, and the cost of
/// its single pixels.
inline void warp_row(const SweepJob& job, const SweepNeighbor& other, const SweepRows& rows,
                     float q, int64_t y) {
  const float* const turn = other.turn;
  Pack<float> start[3], step[3];
  for (int k = 0; k < 3; ++k) {
    start[k] = double(turn[3 * k + 1] * (y + 0.5f) + turn[3 * k + 2] + q * other.shift[k]);
    step[k] = double(turn[3 * k]);
  }
  float lanes[LANES];
  for (int i = 0; i < LANES; ++i) lanes[i] = i + 0.5f;
  const Pack<float> across = load(lanes), one(1.0), zero(0.0), half(0.5);
  const Pack<float> width(double(other.image.width)), height(double(other.image.height));
  const Pack<float> right(other.image.width - 1.0), bottom(other.image.height - 1.0);
  const Pack<float> byte(1.0 / 255.0), limit(LARGEST_DIFFERENCE), unit(1.0 / LARGEST_DIFFERENCE);
  float* const difference = rows.differences + y % WINDOW * rows.length;
  for (int64_t x = 0; x < rows.length; x += LANES) {
    const Pack<float> column = across + Pack<float>(double(x));
    const Pack<float> depth = fma(step[2], column, start[2]);
    const LaneMask<float> before = depth > Pack<float>(1e-6);
    const Pack<float> inverse = one / select(before, depth, one);
    const Pack<float> u = fma(step[0], column, start[0]) * inverse;
    const Pack<float> v = fma(step[1], column, start[1]) * inverse;
    const LaneMask<float> inside = before & (u >= zero) & (v >= zero) & (u < width) & (v < height);
    // What is not a number fails the comparison, and becomes the first place.
    const Pack<float> px = maximum(minimum(keep(inside, u) - half, right), zero);
    const Pack<float> py = maximum(minimum(keep(inside, v) - half, bottom), zero);
    const Pack<float> left = round_down(px), top = round_down(py);
    Pack<float> corners[4];
    gather_bytes(other.image.data, fma(top, width, left), corners);
    const Pack<float> fx = px - left, fy = py - top;
    const Pack<float> above = fma(fx, corners[1] - corners[0], corners[0]);
    const Pack<float> below = fma(fx, corners[3] - corners[2], corners[2]);
    const Pack<float> value = fma(fy, below - above, above) * byte;
    store(rows.warped + LANES + x, value);
    const Pack<float> here = load(rows.reference + LANES + x);
    const Pack<float> cost = minimum(absolute(here - value), limit) * unit;
    store(difference + x, select(inside, cost, Pack<float>(2.0)));
  }
  extend_row(rows.warped, job.width, rows.length);
}

/// Costs of row ``y`` with one neighbour, merged into the least two.
inline void compare_row(const SweepJob& job, const SweepRows& rows, int64_t y, bool is_first) {
  const Pack<float> share(1.0 / (WINDOW * WINDOW)), floor(LEAST_VARIANCE), one(1.0);
  const Pack<float> half((1.0 - DIFFERENCE_SHARE) / 2.0), part(DIFFERENCE_SHARE);
  const int64_t stride = SUMS * rows.length;
  for (int64_t x = 0; x < rows.length; x += LANES) {
    const float* const sums = rows.sums + x;
    const Pack<float> mean = window_sum(sums, y, job.height, stride) * share;
    const Pack<float> squares = window_sum(sums + rows.length, y, job.height, stride) * share;
    const Pack<float> products = window_sum(sums + 2 * rows.length, y, job.height, stride) * share;
    const Pack<float> variance = maximum(fma_negated(mean, mean, squares), floor);
    const int64_t at = y * rows.length + x;
    const Pack<float> covariance = fma_negated(mean, load(rows.mean + at), products);
    const Pack<float> scaled = covariance * load(rows.deviation + at) / square_root(variance);
    const Pack<float> correlation = maximum(minimum(scaled, one), Pack<float>(-1.0));
    const Pack<float> difference = load(rows.differences + y % WINDOW * rows.length + x);
    const Pack<float> cost = fma(part, difference, half * (one - correlation));
    const Pack<float> seen = select(difference > one, one, cost);
    if (is_first) {
      store(rows.least + at, seen);
      store(rows.second + at, job.num_neighbors == 1 ? seen : one);
      continue;
    }
    const Pack<float> least = load(rows.least + at);
    store(rows.second + at, minimum(load(rows.second + at), maximum(least, seen)));
    store(rows.least + at, minimum(least, seen));
  }
}

/// Costs [height, planes, width] of every pixel at every plane.
inline void sweep(const SweepJob& job, uint8_t* costs, float* scratch) {
  const SweepRows rows(job, scratch);
  describe_reference(job, rows);
  const float step = job.planes > 1 ? (job.last - job.first) / float(job.planes - 1) : 0.0f;
  for (int64_t plane = 0; plane < job.planes; ++plane) {
    const float q = job.first + step * float(plane);
    for (int64_t n = 0; n < job.num_neighbors; ++n) {
      for (int64_t next = 0; next < job.height + SWEEP_REACH; ++next) {
        if (next < job.height) {
          take_reference_row(job, rows, next);
          warp_row(job, job.neighbors[n], rows, q, next);
          sum_row(rows, next, rows.warped);
        }
        if (next >= SWEEP_REACH) compare_row(job, rows, next - SWEEP_REACH, n == 0);
      }
    }
    for (int64_t y = 0; y < job.height; ++y) {
      uint8_t* __restrict const to = costs + (y * job.planes + plane) * job.width;
      const float* __restrict const least = rows.least + y * rows.length;
      const float* __restrict const second = rows.second + y * rows.length;
      for (int64_t x = 0; x < job.width; ++x) {
        to[x] = uint8_t(int((least[x] + second[x]) * (0.5f * COST_SCALE) + 0.5f));
      }
    }
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
