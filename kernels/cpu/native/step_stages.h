// Arguments of the native step besides rendering: plain structures, the same in every
// translation unit, and one table of functions per instruction set and type.
#pragma once

#include <stdint.h>

namespace gsfw {

/// Taps of the window of SSIM on one side, and all of them.
constexpr int SSIM_REACH = 5;
constexpr int SSIM_TAPS = 2 * SSIM_REACH + 1;

/// Images that are compared. A row is width * channels numbers, channels interleaved.
template <typename T>
struct Comparison {
  /// [c, h, w, d], and so is the target.
  const T* rendered;
  const T* target;
  /// [c, h, w], 1 where a pixel counts and 0 elsewhere; null when all do.
  const uint8_t* valid;
  int64_t images, height, width, channels;
};

/// L1 and 1 - SSIM of images, summed row by row, and the gradient of SSIM.
template <typename T>
struct SsimJob {
  Comparison<T> images;
  /// Half the window: the centre is the last.
  T window[SSIM_REACH + 1];
  /// Constants c1 and c2 of SSIM.
  T c1, c2;
  /// [c, h, w, d]: ``gradient_scale`` times that of the summed SSIM; null when not asked for.
  T* gradient;
  T gradient_scale;
  /// [c * h, strips] each: sums over a row's part in one strip.
  double* l1_sums;
  double* lack_sums;
  /// Numbers of a row that are one strip, a multiple of 16, and how many strips a row has.
  int64_t strip_length, strips;
};

/// A task of SSIM: rows [top, bottom) of one image within one strip.
struct SsimTask {
  int64_t image, top, bottom, strip;
};

/// From the gradients of the two losses to that of the rendered image.
template <typename T>
struct LossGradientJob {
  Comparison<T> images;
  /// [c, h, w, d]: gradient of the dissimilarity.
  const T* dissimilarity;
  /// Factor of the sign of the difference, and of ``dissimilarity``.
  T l1_scale, dissimilarity_scale;
  /// [c, h, w, d]
  T* gradient;
};

/// Rows that may lie apart: row r begins at ``data + r * stride``.
template <typename T>
struct StridedRows {
  T* data;
  int64_t stride;
};

/// One step of Adam over some rows.
template <typename T>
struct AdamJob {
  StridedRows<T> values;
  StridedRows<const T> gradient;
  StridedRows<T> first, second;
  /// Numbers of a row.
  int64_t width;
  /// [count]: the rows to touch; null for all of them in order.
  const int64_t* rows;
  /// 1 - beta1, beta2 and 1 - beta2.
  T weight1, decay2, weight2;
  /// Second moments are divided by it.
  T bias2;
  /// Learning rate over the bias correction of the first moments.
  T rate;
  T epsilon;
  T gradient_limit;
};

/// Noise that moves positions.
template <typename T>
struct NoiseJob {
  /// [n, 3]; changed in place.
  T* means;
  /// [n, 4], [n, 3] and [n]: see gsfw.core.maths.covariance_noise.
  const T* quats;
  const T* log_scales;
  const T* opacity_logits;
  /// [n, 3]: standard normal numbers.
  const T* noise;
  /// Factor of all shifts; opacity at which they fade out, and how sharply.
  T rate, opacity, sharpness;
};

/// See ssim.h, loss_gradient.h, adam.h, finite.h and noise.h.
template <typename T>
struct StepKernels {
  int64_t (*ssim_scratch)(const SsimJob<T>& job);
  void (*ssim)(const SsimJob<T>& job, const SsimTask& task, T* scratch);
  void (*loss_gradient)(const LossGradientJob<T>& job, int64_t begin, int64_t end);
  void (*adam)(const AdamJob<T>& job, int64_t begin, int64_t end);
  bool (*all_finite)(const T* numbers, int64_t count);
  void (*add_noise)(const NoiseJob<T>& job, int64_t begin, int64_t end);
};

}  // namespace gsfw
