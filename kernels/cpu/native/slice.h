// Slices of Gaussians of space and time and their gradients, sixteen rows at a time.
#pragma once

#include "field_stages.h"
#include "simd/simd.h"
#include "slices.h"

namespace gsfw {
namespace GSFW_ISA {

/// The sixteen rows from ``row`` on, or those that are left.
template <typename T>
GSFW_FUNCTION Slice<Pack<T>> slice_rows(const SliceJob<T>& job, int64_t row, int64_t count) {
  SpaceTime<Pack<T>> of;
  load_rows<AXES>(job.left + AXES * row, count, of.left);
  load_rows<AXES>(job.right + AXES * row, count, of.right);
  load_rows<AXES>(job.scales + AXES * row, count, of.scales);
  return Slice<Pack<T>>(of);
}

/// Covariances [n, 9], velocities [n, 3] and variances [n] of rows [begin, end).
template <typename T>
void slice(const SliceJob<T>& job, int64_t begin, int64_t end) {
  for (int64_t row = begin; row < end; row += LANES) {
    const int64_t count = end - row < LANES ? end - row : LANES;
    const LaneMask<T> there = first_lanes<T>(count);
    const Slice<Pack<T>> of = slice_rows(job, row, count);
    T* const covariances = job.covariances + COVARIANCE_ENTRIES * row;
    for (int a = 0; a < SPACE_AXES; ++a) {
      for (int b = 0; b <= a; ++b) {
        const Pack<T> entry = of.covariance(a, b);
        store_strided(covariances + SPACE_AXES * a + b, COVARIANCE_ENTRIES, there, entry);
        if (a == b) continue;
        store_strided(covariances + SPACE_AXES * b + a, COVARIANCE_ENTRIES, there, entry);
      }
    }
    Pack<T> velocities[SPACE_AXES];
    for (int i = 0; i < SPACE_AXES; ++i) velocities[i] = of.velocity(i);
    store_rows<SPACE_AXES>(job.velocities + SPACE_AXES * row, count, velocities);
    store_strided(job.variances + row, 1, there, of.variance);
  }
}

/// Gradients [n, 4] of left, right and scales for rows [begin, end).
template <typename T>
void slice_backward(const SliceJob<T>& job, const SliceGradients<T>& gradients, int64_t begin,
                    int64_t end) {
  for (int64_t row = begin; row < end; row += LANES) {
    const int64_t count = end - row < LANES ? end - row : LANES;
    const Slice<Pack<T>> of = slice_rows(job, row, count);
    SliceFlows<Pack<T>> flows(load_strided(gradients.variances + row, 1, count));
    Pack<T> velocities[SPACE_AXES];
    load_rows<SPACE_AXES>(gradients.velocities + SPACE_AXES * row, count, velocities);
    for (int i = 0; i < SPACE_AXES; ++i) flows.add_velocity(of, i, velocities[i]);
    const T* const covariances = gradients.covariances + COVARIANCE_ENTRIES * row;
    for (int a = 0; a < SPACE_AXES; ++a) {
      Pack<T> symmetric[SPACE_AXES];
      for (int b = 0; b < SPACE_AXES; ++b) {
        symmetric[b] = load_strided(covariances + SPACE_AXES * a + b, COVARIANCE_ENTRIES, count) +
                       load_strided(covariances + SPACE_AXES * b + a, COVARIANCE_ENTRIES, count);
      }
      flows.add_covariance(of, a, symmetric);
    }
    const SpaceTime<Pack<T>> to = flows.finish(of);
    store_rows<AXES>(gradients.left + AXES * row, count, to.left);
    store_rows<AXES>(gradients.right + AXES * row, count, to.right);
    store_rows<AXES>(gradients.scales + AXES * row, count, to.scales);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
