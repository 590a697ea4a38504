// From the gradients of L1 and dissimilarity to that of the rendered image.
#pragma once

#include "simd/simd.h"
#include "step_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Pixels [begin, end) of all images; the sign of 0 is 0. Where a pixel does not count, so is its
/// gradient.
template <typename T>
void loss_gradient(const LossGradientJob<T>& job, int64_t begin, int64_t end) {
  const int64_t d = job.images.channels, last = end * d;
  const Pack<T> l1(job.l1_scale), dissimilarity(job.dissimilarity_scale), zero(T(0));
  for (int64_t i = begin * d; i < last; i += LANES) {
    const int64_t count = last - i;
    const Pack<T> x = load_strided(job.images.rendered + i, 1, count);
    const Pack<T> difference = x - load_strided(job.images.target + i, 1, count);
    const Pack<T> sign = keep(difference > zero, l1) - keep(difference < zero, l1);
    const Pack<T> flow = load_strided(job.dissimilarity + i, 1, count);
    store_strided(job.gradient + i, 1, first_lanes<T>(count), fma(dissimilarity, flow, sign));
  }
  if (job.images.valid == nullptr) return;
  for (int64_t pixel = begin; pixel < end; ++pixel) {
    if (job.images.valid[pixel]) continue;
    for (int64_t k = 0; k < d; ++k) job.gradient[pixel * d + k] = T(0);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
