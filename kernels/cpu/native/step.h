// The step besides rendering: losses, optimizer, check of gradients and noise of positions, on any
// number of threads.
//
// Results are the same to the bit for any number of threads: every number is computed by itself,
// and sums are taken row by row and then in order.
#pragma once

#include "step_stages.h"

namespace gsfw {

struct Losses {
  /// Mean absolute difference, and 1 - SSIM, over the pixels that count; 0 and 1 without any.
  double l1, dissimilarity;
};

/// Both losses; ``gradient`` [c, h, w, d] receives that of the dissimilarity unless it is null.
template <typename T>
Losses l1_dissimilarity(const Comparison<T>& images, T* gradient, int threads);

/// ``gradient`` [c, h, w, d] = ``l1`` times the gradient of the mean absolute difference plus
/// ``dissimilarity`` times ``dissimilarity_gradient`` [c, h, w, d].
template <typename T>
void loss_gradient(const Comparison<T>& images, const T* dissimilarity_gradient, double l1,
                   double dissimilarity, T* gradient, int threads);

/// One step of Adam over ``count`` rows.
template <typename T>
void adam_step(const AdamJob<T>& job, int64_t count, int threads);

/// Whether none of ``numbers`` [count] is infinite or NaN.
template <typename T>
bool all_finite(const T* numbers, int64_t count, int threads);

/// Add noise shaped by covariances to the positions of ``count`` Gaussians.
template <typename T>
void add_noise(const NoiseJob<T>& job, int64_t count, int threads);

}  // namespace gsfw
