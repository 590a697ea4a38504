// Noise shaped by each Gaussian's covariance, added to its position (Kheradmand et al. 2024,
// equation 8): as gsfw.core.maths.covariance_noise has it, sixteen rows at a time in one pass over
// memory.
#pragma once

#include "rotation.h"
#include "simd/simd.h"
#include "step_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Least norm of a quaternion, below which it counts as the identity.
constexpr double NOISE_MIN_NORM = 1e-12;

/// e to the power of each lane; powers beyond float32 count as its largest power of two.
template <typename T>
GSFW_FUNCTION Pack<T> exponential(const Pack<T>& x) {
  constexpr double LOG2_E = 1.4426950408889634;
  return power_of_two(minimum(Pack<T>(126.0), x * Pack<T>(LOG2_E)));
}

/// 1 / (1 + e^-x).
template <typename T>
GSFW_FUNCTION Pack<T> logistic(const Pack<T>& x) {
  const Pack<T> zero(0.0), one(1.0), falling = exponential(-absolute(x));
  return select(x >= zero, one, falling) / (one + falling);
}

/// Move rows [begin, end).
template <typename T>
void add_noise(const NoiseJob<T>& job, int64_t begin, int64_t end) {
  const Pack<T> sharpness(job.sharpness), middle(job.opacity), rate(job.rate), two(2.0);
  for (int64_t start = begin; start < end; start += LANES) {
    const int64_t count = end - start < LANES ? end - start : LANES;
    Pack<T> means[3], quat[4], log_scales[3], noise[3];
    load_rows<3>(job.means + 3 * start, count, means);
    load_rows<4>(job.quats + 4 * start, count, quat);
    load_rows<3>(job.log_scales + 3 * start, count, log_scales);
    load_rows<3>(job.noise + 3 * start, count, noise);
    const Pack<T> opacity = logistic(load_strided(job.opacity_logits + start, 1, count));
    const Pack<T> factor = rate * logistic(sharpness * (middle - opacity));
    const Quaternion<Pack<T>> given{quat[0], quat[1], quat[2], quat[3]};
    const Matrix3<Pack<T>> turned =
        rotation_matrix(orientation(given, Pack<T>(NOISE_MIN_NORM)).unit);
    const Vector3<Pack<T>> variances{exponential(two * log_scales[0]),
                                     exponential(two * log_scales[1]),
                                     exponential(two * log_scales[2])};
    const Vector3<Pack<T>> normal{noise[0], noise[1], noise[2]};
    const Vector3<Pack<T>> shaped = turned * product(normal * turned, variances);
    const Pack<T> moved[3] = {fma(factor, shaped.x, means[0]), fma(factor, shaped.y, means[1]),
                              fma(factor, shaped.z, means[2])};
    store_rows<3>(job.means + 3 * start, count, moved);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
