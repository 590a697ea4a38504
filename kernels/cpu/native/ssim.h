// L1 and SSIM of two images, with the gradient of SSIM, in one sweep down the rows.
//
// Wang et al. 2004, equation 13, with zero padding. With u = x + y and v = x - y
//     SSIM = (A - B + 2 c1) (U - V + 2 c2) / ((A + B + 2 c1) (U + V + 2 c2)),
// where A and B are the squared window means of u and v, and U and V their variances: four blurred
// maps instead of five, and 1 - SSIM loses no digits where the images agree, for then v, B and V
// vanish. Channels are interleaved, so that a tap to the side is ``channels`` numbers away and no
// image is rearranged. The sweep keeps the last 16 rows of everything; a pixel's result depends
// on no other task.
#pragma once

#include "simd/simd.h"
#include "step_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Rows that are made at once, so that each blurred row is read fewer times.
constexpr int SSIM_ROWS = 4;
/// Rows that are remembered, a power of two: those that four windows cover, 14, and two to spare.
constexpr int SSIM_RING = 16;
/// Blurred maps of the images: u, v, u^2, v^2; and of what flows back: to the means, U and V.
constexpr int SSIM_MAPS = 4, SSIM_FLOWS = 3;

/// A strip of an image, its borders, and one thread's working memory. Positions in ``u``, ``v``
/// and ``weights`` count from ``left`` - 2 ``margin``; in ``blurred``, ``flows`` and ``lacks`` from
/// ``left`` - ``margin``; in ``returned`` from ``left``.
template <typename T>
struct SsimStrip {
  int64_t left, right, margin, channels, row_length, height;
  /// Between rows: the length of the longest, and room for one pack more.
  int64_t stride;
  T *u, *v;
  /// 1 for the pixels that count, 0 for those that do not and outside the image. [16, stride]
  /// with a mask; without, one row for all rows inside the image.
  T *weights, *no_weights;
  /// [16, 4, stride]
  T* blurred;
  /// [4, 3, stride] and [4, stride]
  T *flows, *lacks;
  /// [16, 3, stride]
  T* returned;
};

template <typename T>
GSFW_FUNCTION int64_t ssim_stride(const SsimJob<T>& job) {
  const int64_t reach = 4 * SSIM_REACH * job.images.channels;
  return (job.strip_length + reach + 2 * LANES - 1) / LANES * LANES;
}

/// Working memory of one thread, in numbers of T.
template <typename T>
int64_t ssim_scratch(const SsimJob<T>& job) {
  const int64_t rows = 2 + SSIM_RING + 1 + SSIM_RING * (SSIM_MAPS + SSIM_FLOWS) +
                       SSIM_ROWS * (SSIM_FLOWS + 1);
  return rows * ssim_stride(job);
}

template <typename T>
GSFW_FUNCTION SsimStrip<T> strip_of(const SsimJob<T>& job, int64_t strip, T* scratch) {
  SsimStrip<T> at;
  at.channels = job.images.channels;
  at.row_length = job.images.width * job.images.channels;
  at.height = job.images.height;
  at.left = strip * job.strip_length;
  at.right = at.left + job.strip_length;
  if (at.right > at.row_length) at.right = at.row_length;
  at.margin = SSIM_REACH * at.channels;
  at.stride = ssim_stride(job);
  T** const parts[] = {&at.u,       &at.v,     &at.weights, &at.no_weights,
                       &at.blurred, &at.flows, &at.lacks,   &at.returned};
  const int rows[] = {1, 1, SSIM_RING, 1, SSIM_RING * SSIM_MAPS, SSIM_ROWS * SSIM_FLOWS, SSIM_ROWS,
                      SSIM_RING * SSIM_FLOWS};
  for (int i = 0; i < 8; ++i) {
    *parts[i] = scratch;
    scratch += rows[i] * at.stride;
  }
  return at;
}

template <typename T>
GSFW_FUNCTION void fill(T* to, int64_t count, T value) {
  for (int64_t i = 0; i < count; ++i) to[i] = value;
}

/// Slot of a row in a ring.
GSFW_FUNCTION int64_t slot(int64_t row) { return row & (SSIM_RING - 1); }

template <typename T>
GSFW_FUNCTION const T* weights_of(const SsimStrip<T>& at, bool masked, int64_t row) {
  if (row < 0 || row >= at.height) return at.no_weights;
  return masked ? at.weights + slot(row) * at.stride : at.weights;
}

/// Range of the strip with its borders in the image: numbers [first, last) of a row, the first
/// of them at position ``lead``.
struct SsimRange {
  int64_t first, last, lead;
};

template <typename T>
GSFW_FUNCTION SsimRange range_of(const SsimStrip<T>& at) {
  const int64_t begin = at.left - 2 * at.margin, end = at.right + 2 * at.margin;
  const int64_t first = begin < 0 ? 0 : begin;
  return {first, end < at.row_length ? end : at.row_length, first - begin};
}

/// The weights of a row, from its part of the mask or, where that is null, all 1.
template <typename T>
GSFW_FUNCTION void spread_weights(const SsimStrip<T>& at, const uint8_t* valid, T* to) {
  const SsimRange range = range_of(at);
  const int64_t count = range.last - range.first;
  fill(to, range.lead, T(0));
  fill(to + range.lead + count, at.stride - range.lead - count, T(0));
  if (valid == nullptr) return fill(to + range.lead, count, T(1));
  int64_t pixel = range.first / at.channels, channel = range.first % at.channels;
  for (int64_t i = 0; i < count; ++i) {
    to[range.lead + i] = valid[pixel] ? T(1) : T(0);
    if (++channel == at.channels) {
      channel = 0;
      ++pixel;
    }
  }
}

/// u and v of a row; pixels that do not count take the target's value.
template <typename T>
GSFW_FUNCTION void load_row(const SsimJob<T>& job, const SsimStrip<T>& at, int64_t image_row,
                            const T* weights) {
  const SsimRange range = range_of(at);
  const int64_t count = range.last - range.first;
  const T* x = job.images.rendered + image_row * at.row_length + range.first;
  const T* y = job.images.target + image_row * at.row_length + range.first;
  fill(at.u, range.lead, T(0));
  fill(at.v, range.lead, T(0));
  T *u = at.u + range.lead, *v = at.v + range.lead;
  const T* weight = weights + range.lead;
  const bool masked = job.images.valid != nullptr;
  for (int64_t i = 0; i < count; i += LANES) {
    Pack<T> of_x = load_strided(x + i, 1, count - i);
    const Pack<T> of_y = load_strided(y + i, 1, count - i);
    if (masked) of_x = select(load(weight + i) > Pack<T>(T(0)), of_x, of_y);
    store(u + i, of_x + of_y);
    store(v + i, of_x - of_y);
  }
  const int64_t rest = at.stride - range.lead - count;
  fill(u + count, rest, T(0));
  fill(v + count, rest, T(0));
}

/// Sum of |x - y| over the strip's part of a row. Reads the images themselves, so that, as in
/// plain torch, a NaN shows even where it does not count.
template <typename T>
GSFW_FUNCTION double l1_of_row(const SsimJob<T>& job, const SsimStrip<T>& at, int64_t image_row,
                               const T* weights) {
  const T* x = job.images.rendered + image_row * at.row_length + at.left;
  const T* y = job.images.target + image_row * at.row_length + at.left;
  const T* weight = weights + 2 * at.margin;
  const int64_t count = at.right - at.left;
  Pack<T> total(T(0));
  for (int64_t i = 0; i < count; i += LANES) {
    const Pack<T> of_x = load_strided(x + i, 1, count - i);
    const Pack<T> of_y = load_strided(y + i, 1, count - i);
    total = fma(absolute(of_x - of_y), load(weight + i), total);
  }
  return double(sum(total));
}

template <typename T>
GSFW_FUNCTION double sum_of(const T* numbers, int64_t count) {
  Pack<T> total(T(0));
  for (int64_t i = 0; i < count; i += LANES) {
    total = total + load_strided(numbers + i, 1, count - i);
  }
  return double(sum(total));
}

/// u, v, u^2 and v^2 of a row, blurred sideways.
template <typename T>
GSFW_FUNCTION void blur_images(const SsimStrip<T>& at, const Pack<T>* window, T* to) {
  const int64_t d = at.channels, length = at.right - at.left + 2 * at.margin;
  for (int64_t i = 0; i < length; i += LANES) {
    const Pack<T> u = load(at.u + i + at.margin), v = load(at.v + i + at.margin);
    Pack<T> sum_u = window[SSIM_REACH] * u, sum_v = window[SSIM_REACH] * v;
    Pack<T> sum_uu = sum_u * u, sum_vv = sum_v * v;
    for (int k = 0; k < SSIM_REACH; ++k) {
      const int64_t near = i + k * d, far = i + (SSIM_TAPS - 1 - k) * d;
      const Pack<T> u1 = load(at.u + near), u2 = load(at.u + far);
      const Pack<T> v1 = load(at.v + near), v2 = load(at.v + far);
      sum_u = fma(window[k], u1 + u2, sum_u);
      sum_v = fma(window[k], v1 + v2, sum_v);
      sum_uu = fma(window[k], fma(u1, u1, u2 * u2), sum_uu);
      sum_vv = fma(window[k], fma(v1, v1, v2 * v2), sum_vv);
    }
    store(to + i, sum_u);
    store(to + at.stride + i, sum_v);
    store(to + 2 * at.stride + i, sum_uu);
    store(to + 3 * at.stride + i, sum_vv);
  }
}

/// ``length`` numbers of a row, blurred sideways.
template <typename T>
GSFW_FUNCTION void blur_row(const T* from, int64_t d, int64_t length, const Pack<T>* window,
                            T* to) {
  for (int64_t i = 0; i < length; i += LANES) {
    Pack<T> total = window[SSIM_REACH] * load(from + i + SSIM_REACH * d);
    for (int k = 0; k < SSIM_REACH; ++k) {
      total = fma(window[k], load(from + i + k * d) + load(from + i + (SSIM_TAPS - 1 - k) * d),
                  total);
    }
    store(to + i, total);
  }
}

/// Four rows of a map, blurred downwards, from the fourteen that their windows cover.
template <typename T>
GSFW_FUNCTION void blur_down(const T* const* rows, int64_t i, const Pack<T>* window, Pack<T>* to) {
  Pack<T> in[SSIM_ROWS + SSIM_TAPS - 1];
  for (int k = 0; k < SSIM_ROWS + SSIM_TAPS - 1; ++k) in[k] = load(rows[k] + i);
  for (int r = 0; r < SSIM_ROWS; ++r) {
    to[r] = window[SSIM_REACH] * in[r + SSIM_REACH];
    for (int k = 0; k < SSIM_REACH; ++k) {
      to[r] = fma(window[k], in[r + k] + in[r + SSIM_TAPS - 1 - k], to[r]);
    }
  }
}

/// The rows of a ring that the windows of rows ``row`` to ``row`` + 3 cover.
template <typename T>
GSFW_FUNCTION void rows_around(const T* ring, int64_t stride, int64_t row, const T** rows) {
  for (int k = 0; k < SSIM_ROWS + SSIM_TAPS - 1; ++k) {
    rows[k] = ring + slot(row - SSIM_REACH + k) * stride;
  }
}

/// 1 - SSIM, and a quarter of SSIM's derivatives: with respect to the blurred x, and half of those
/// with respect to the blurred u^2 and v^2.
template <typename T>
struct Similarity {
  Pack<T> lack, to_mean, to_uu, to_vv;
};

template <typename T>
GSFW_FUNCTION Similarity<T> similarity_of(const SsimJob<T>& job, const Pack<T>* blurred) {
  const Pack<T> mean_u = blurred[0], mean_v = blurred[1];
  const Pack<T> a = mean_u * mean_u, b = mean_v * mean_v;
  const Pack<T> u = blurred[2] - a, v = blurred[3] - b;
  const Pack<T> c1(T(2) * job.c1), c2(T(2) * job.c2);
  const Pack<T> p = a + b + c1, q = u + v + c2;
  const Pack<T> alike_p = a - b + c1, alike_q = u - v + c2;
  const Pack<T> denominator = p * q, one_over = Pack<T>(T(1)) / denominator;
  const Pack<T> over_p = one_over * q, over_q = one_over * p;
  const Pack<T> luminance = alike_p * over_p, structure = alike_q * over_q;
  const Pack<T> lack = (denominator - alike_p * alike_q) * one_over;
  // 1 - luminance is 2 b / p and 1 + luminance is 2 (a + c1) / p; likewise with structure.
  const Pack<T> for_u = luminance * over_q * over_q, for_a = structure * over_p * over_p;
  const Pack<T> by_u = for_u * v, by_v = -(for_u * (u + c2));
  const Pack<T> by_a = for_a * b, by_b = -(for_a * (a + c1));
  return {lack, fma(mean_u, by_a - by_u, mean_v * (by_b - by_v)), by_u, by_v};
}

/// Similarity and what flows back for rows ``row`` to ``row`` + 3, whose sums go to the job; flows
/// are blurred sideways at once.
template <typename T, bool GRADIENT>
GSFW_FUNCTION void compare_rows(const SsimJob<T>& job, const SsimStrip<T>& at,
                                const SsimTask& task, int64_t row, const Pack<T>* window) {
  const int64_t length = at.right - at.left + 2 * at.margin;
  const T* rows[SSIM_ROWS + SSIM_TAPS - 1];
  const T* weights[SSIM_ROWS];
  rows_around(at.blurred, SSIM_MAPS * at.stride, row, rows);
  for (int r = 0; r < SSIM_ROWS; ++r) {
    weights[r] = weights_of(at, job.images.valid != nullptr, row + r) + at.margin;
  }
  for (int64_t i = 0; i < length; i += LANES) {
    Pack<T> blurred[SSIM_MAPS][SSIM_ROWS];
    for (int map = 0; map < SSIM_MAPS; ++map) {
      blur_down(rows, map * at.stride + i, window, blurred[map]);
    }
    for (int r = 0; r < SSIM_ROWS; ++r) {
      const Pack<T> maps[] = {blurred[0][r], blurred[1][r], blurred[2][r], blurred[3][r]};
      const Similarity<T> is = similarity_of(job, maps);
      const Pack<T> weight = load(weights[r] + i);
      store(at.lacks + r * at.stride + i, is.lack * weight);
      if (!GRADIENT) continue;
      T* flow = at.flows + r * SSIM_FLOWS * at.stride + i;
      store(flow, is.to_mean * weight);
      store(flow + at.stride, is.to_uu * weight);
      store(flow + 2 * at.stride, is.to_vv * weight);
    }
  }
  for (int r = 0; r < SSIM_ROWS; ++r) {
    if (row + r >= task.top && row + r < task.bottom) {
      const int64_t sums = (task.image * at.height + row + r) * job.strips + task.strip;
      const T* lacks = at.lacks + r * at.stride + at.margin;
      job.lack_sums[sums] = sum_of(lacks, at.right - at.left);
    }
    for (int flow = 0; GRADIENT && flow < SSIM_FLOWS; ++flow) {
      blur_row(at.flows + (r * SSIM_FLOWS + flow) * at.stride, at.channels, at.right - at.left,
               window, at.returned + (slot(row + r) * SSIM_FLOWS + flow) * at.stride);
    }
  }
}

/// Gradient of rows ``row`` to ``row`` + 3, of those before ``bottom``.
template <typename T>
GSFW_FUNCTION void return_rows(const SsimJob<T>& job, const SsimStrip<T>& at, const SsimTask& task,
                               int64_t row, const Pack<T>* window) {
  const int64_t count = at.right - at.left;
  const Pack<T> scale(T(4) * job.gradient_scale);
  const T* rows[SSIM_ROWS + SSIM_TAPS - 1];
  rows_around(at.returned, SSIM_FLOWS * at.stride, row, rows);
  const int made = int(task.bottom - row < SSIM_ROWS ? task.bottom - row : SSIM_ROWS);
  for (int64_t i = 0; i < count; i += LANES) {
    Pack<T> blurred[SSIM_FLOWS][SSIM_ROWS];
    for (int flow = 0; flow < SSIM_FLOWS; ++flow) {
      blur_down(rows, flow * at.stride + i, window, blurred[flow]);
    }
    for (int r = 0; r < made; ++r) {
      const T* weight = weights_of(at, job.images.valid != nullptr, row + r) + 2 * at.margin + i;
      const int64_t from = (task.image * at.height + row + r) * at.row_length + at.left + i;
      const Pack<T> x = load_strided(job.images.rendered + from, 1, count - i);
      const Pack<T> y = load_strided(job.images.target + from, 1, count - i);
      const Pack<T> total =
          fma(x + y, blurred[1][r], fma(x - y, blurred[2][r], blurred[0][r]));
      const LaneMask<T> there = first_lanes<T>(count - i);
      store_strided(job.gradient + from, 1, there, total * scale * load(weight));
    }
  }
}

/// Read a row, and keep it blurred sideways; rows outside the image are black.
template <typename T>
GSFW_FUNCTION void take_row(const SsimJob<T>& job, const SsimStrip<T>& at, const SsimTask& task,
                            int64_t row, const Pack<T>* window) {
  T* blurred = at.blurred + slot(row) * SSIM_MAPS * at.stride;
  if (row < 0 || row >= at.height) return fill(blurred, SSIM_MAPS * at.stride, T(0));
  const int64_t image_row = task.image * at.height + row;
  T* weights = at.weights;
  if (job.images.valid != nullptr) {
    weights += slot(row) * at.stride;
    spread_weights(at, job.images.valid + image_row * job.images.width, weights);
  }
  load_row(job, at, image_row, weights);
  if (row >= task.top && row < task.bottom) {
    job.l1_sums[image_row * job.strips + task.strip] = l1_of_row(job, at, image_row, weights);
  }
  blur_images(at, window, blurred);
}

/// Sweep down the rows of a task: each is read five rows ahead of its own similarity, and that five
/// rows ahead of its gradient.
template <typename T, bool GRADIENT>
void sweep(const SsimJob<T>& job, const SsimTask& task, T* scratch) {
  const SsimStrip<T> at = strip_of(job, task.strip, scratch);
  Pack<T> window[SSIM_REACH + 1];
  for (int k = 0; k <= SSIM_REACH; ++k) window[k] = Pack<T>(job.window[k]);
  fill(at.no_weights, at.stride, T(0));
  if (job.images.valid == nullptr) spread_weights(at, nullptr, at.weights);
  // The first similarities that a gradient needs are five rows above it, in a group of four.
  const int64_t above = GRADIENT ? SSIM_REACH : 0, start = task.top - above - (GRADIENT ? 2 : 0);
  for (int64_t row = start - SSIM_REACH; row < start + SSIM_REACH; ++row) {
    take_row(job, at, task, row, window);
  }
  for (int64_t row = start; row - above < task.bottom; row += SSIM_ROWS) {
    for (int r = 0; r < SSIM_ROWS; ++r) take_row(job, at, task, row + SSIM_REACH + r, window);
    compare_rows<T, GRADIENT>(job, at, task, row, window);
    if (GRADIENT && row - above >= task.top) return_rows(job, at, task, row - above, window);
  }
}

/// L1 and similarity of a task's rows, and the gradient of the latter where the job asks for it.
template <typename T>
void ssim(const SsimJob<T>& job, const SsimTask& task, T* scratch) {
  if (job.gradient) return sweep<T, true>(job, task, scratch);
  sweep<T, false>(job, task, scratch);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
