// Slices of Gaussians of space and time: covariance, velocity and temporal variance, and gradients.
//
// As gsfw.core.maths.slices has it, which gives the equations (Duan et al. 2024; Yang et al. 2024)
// and says why nothing cancels. Sixteen rows at a time.
#pragma once

#include "field_stages.h"
#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Least norm of a quaternion, below which it counts as the identity; least variance of the time.
constexpr double LEAST_NORM = 1e-12, LEAST_VARIANCE = 1e-30;

/// Signs and components of the matrices of x -> q x and x -> x conj(q), for points x, y, z, t and
/// q = (w, x, y, z): entry [row][k] is component ``of`` with ``sign``.
struct Signed {
  int of;
  double sign;
};
constexpr Signed LEFT_ROWS[4][4] = {{{0, 1}, {3, -1}, {2, 1}, {1, 1}},
                                    {{3, 1}, {0, 1}, {1, -1}, {2, 1}},
                                    {{2, -1}, {1, 1}, {0, 1}, {3, 1}},
                                    {{1, -1}, {2, -1}, {3, -1}, {0, 1}}};
constexpr Signed RIGHT_COLUMNS[4][4] = {{{0, 1}, {3, 1}, {2, -1}, {1, 1}},
                                        {{3, -1}, {0, 1}, {1, 1}, {2, 1}},
                                        {{2, 1}, {1, -1}, {0, 1}, {3, 1}},
                                        {{1, -1}, {2, -1}, {3, -1}, {0, 1}}};

template <typename T>
GSFW_FUNCTION Pack<T> entry(const Pack<T>* quat, Signed at) {
  return at.sign > 0 ? quat[at.of] : -quat[at.of];
}

/// A quaternion of norm 1, and one over the norm before; 0 where it counts as the identity.
template <typename T>
GSFW_FUNCTION void normalise(Pack<T>* quat, Pack<T>* inverse) {
  const Pack<T> zero(0.0), one(1.0);
  Pack<T> size = zero;
  for (int k = 0; k < 4; ++k) size = maximum(size, absolute(quat[k]));
  LaneMask<T> there = size > Pack<T>(LEAST_NORM);
  for (int k = 0; k < 4; ++k) there = there & (quat[k] <= quat[k]);  // NaN is the identity too.
  const Pack<T> scale = select(there, size, one);
  Pack<T> square(0.0);
  for (int k = 0; k < 4; ++k) {
    quat[k] = select(there, quat[k] / scale, k == 0 ? one : zero);
    square = fma(quat[k], quat[k], square);
  }
  const Pack<T> norm = square_root(square);
  for (int k = 0; k < 4; ++k) quat[k] = quat[k] / norm;
  *inverse = keep(there, one / (norm * scale));
}

/// Everything of sixteen rows that both passes need.
template <typename T>
struct SlicedRows {
  Pack<T> left[4], right[4], left_inverse, right_inverse, scales[4];
  /// Rotation; its last row has the components of each axis along time.
  Pack<T> rotation[4][4];
  Pack<T> pulls[4], variance, inverse;
  LaneMask<T> long_enough;
  /// Sum over k of (row_j time_k - row_k time_j) pull_k.
  Pack<T> pulled[3][4];

  GSFW_FUNCTION SlicedRows(const SliceJob<T>& job, int64_t row, int64_t count) {
    load_rows<4>(job.left + 4 * row, count, left);
    load_rows<4>(job.right + 4 * row, count, right);
    load_rows<4>(job.scales + 4 * row, count, scales);
    normalise(left, &left_inverse);
    normalise(right, &right_inverse);
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        Pack<T> total = entry(left, LEFT_ROWS[i][0]) * entry(right, RIGHT_COLUMNS[j][0]);
        for (int k = 1; k < 4; ++k) {
          total = fma(entry(left, LEFT_ROWS[i][k]), entry(right, RIGHT_COLUMNS[j][k]), total);
        }
        rotation[i][j] = total;
      }
    }
    const Pack<T>* const time = rotation[3];
    Pack<T> sum(0.0);
    for (int k = 0; k < 4; ++k) {
      pulls[k] = scales[k] * scales[k] * time[k];
      sum = fma(time[k] * scales[k], time[k] * scales[k], sum);
    }
    long_enough = sum >= Pack<T>(LEAST_VARIANCE);
    variance = maximum(Pack<T>(LEAST_VARIANCE), sum);  // NaN stays NaN.
    inverse = Pack<T>(1.0) / variance;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 4; ++j) {
        Pack<T> total(0.0);
        for (int k = 0; k < 4; ++k) {
          if (k != j) total = fma(minor(i, j, k), pulls[k], total);
        }
        pulled[i][j] = total;
      }
    }
  }

  /// row_j time_k - row_k time_j, of row i.
  GSFW_FUNCTION Pack<T> minor(int i, int j, int k) const {
    return rotation[i][j] * rotation[3][k] - rotation[i][k] * rotation[3][j];
  }

  /// Factor of the covariance.
  GSFW_FUNCTION Pack<T> factor(int i, int j) const { return pulled[i][j] * (scales[j] * inverse); }

  GSFW_FUNCTION Pack<T> velocity(int i) const {
    Pack<T> total = rotation[i][0] * pulls[0];
    for (int k = 1; k < 4; ++k) total = fma(rotation[i][k], pulls[k], total);
    return total * inverse;
  }
};

/// Covariances [n, 9], velocities [n, 3] and variances [n] of rows [begin, end).
template <typename T>
void slice(const SliceJob<T>& job, int64_t begin, int64_t end) {
  for (int64_t row = begin; row < end; row += LANES) {
    const int64_t count = end - row < LANES ? end - row : LANES;
    const LaneMask<T> there = first_lanes<T>(count);
    const SlicedRows<T> of(job, row, count);
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b <= a; ++b) {
        Pack<T> total = of.factor(a, 0) * of.factor(b, 0);
        for (int j = 1; j < 4; ++j) total = fma(of.factor(a, j), of.factor(b, j), total);
        store_strided(job.covariances + 9 * row + 3 * a + b, 9, there, total);
        if (a != b) store_strided(job.covariances + 9 * row + 3 * b + a, 9, there, total);
      }
    }
    Pack<T> velocities[3];
    for (int i = 0; i < 3; ++i) velocities[i] = of.velocity(i);
    store_rows<3>(job.velocities + 3 * row, count, velocities);
    store_strided(job.variances + row, 1, there, of.variance);
  }
}

/// Gradients of sixteen rows' rotation, pulls, scales and variance, which are added up.
template <typename T>
struct SliceFlows {
  Pack<T> rotation[4][4], pulls[4], scales[4], variance;

  GSFW_FUNCTION SliceFlows() : variance(0.0) {
    for (int i = 0; i < 4; ++i) {
      pulls[i] = scales[i] = Pack<T>(0.0);
      for (int j = 0; j < 4; ++j) rotation[i][j] = Pack<T>(0.0);
    }
  }

  /// From the gradient of factor (i, j).
  GSFW_FUNCTION void add_factor(const SlicedRows<T>& of, int i, int j, const Pack<T>& gradient) {
    const Pack<T> by_scale = gradient * of.pulled[i][j] * of.inverse;
    scales[j] = scales[j] + by_scale;
    variance = variance - by_scale * (of.scales[j] * of.inverse);
    const Pack<T> flow = gradient * (of.scales[j] * of.inverse);
    for (int k = 0; k < 4; ++k) {
      if (k == j) continue;
      const Pack<T> pulled = flow * of.pulls[k];
      rotation[i][j] = fma(pulled, of.rotation[3][k], rotation[i][j]);
      rotation[i][k] = fma_negated(pulled, of.rotation[3][j], rotation[i][k]);
      rotation[3][k] = fma(pulled, of.rotation[i][j], rotation[3][k]);
      rotation[3][j] = fma_negated(pulled, of.rotation[i][k], rotation[3][j]);
      pulls[k] = fma(flow, of.minor(i, j, k), pulls[k]);
    }
  }

  /// From the gradient of velocity i.
  GSFW_FUNCTION void add_velocity(const SlicedRows<T>& of, int i, const Pack<T>& gradient) {
    const Pack<T> flow = gradient * of.inverse;
    for (int k = 0; k < 4; ++k) {
      rotation[i][k] = fma(flow, of.pulls[k], rotation[i][k]);
      pulls[k] = fma(flow, of.rotation[i][k], pulls[k]);
    }
    variance = variance - flow * of.velocity(i);
  }

  /// From pulls and variance to scales and to the row of time.
  GSFW_FUNCTION void finish(const SlicedRows<T>& of) {
    const Pack<T> twice = keep(of.long_enough, variance + variance);
    for (int k = 0; k < 4; ++k) {
      const Pack<T> square = of.scales[k] * of.scales[k], time = of.rotation[3][k];
      rotation[3][k] = fma(fma(twice, time, pulls[k]), square, rotation[3][k]);
      const Pack<T> once = of.scales[k] * time;
      scales[k] = fma(fma(twice, time, pulls[k] + pulls[k]), once, scales[k]);
    }
  }
};

/// Gradient of a quaternion before it was normalised.
template <typename T>
GSFW_FUNCTION void through_norm(const Pack<T>* quat, const Pack<T>& inverse, Pack<T>* gradient) {
  Pack<T> along = quat[0] * gradient[0];
  for (int k = 1; k < 4; ++k) along = fma(quat[k], gradient[k], along);
  for (int k = 0; k < 4; ++k) gradient[k] = fma_negated(along, quat[k], gradient[k]) * inverse;
}

/// Gradients [n, 4] of left, right and scales for rows [begin, end).
template <typename T>
void slice_backward(const SliceJob<T>& job, const SliceGradients<T>& gradients, int64_t begin,
                    int64_t end) {
  for (int64_t row = begin; row < end; row += LANES) {
    const int64_t count = end - row < LANES ? end - row : LANES;
    const SlicedRows<T> of(job, row, count);
    SliceFlows<T> flows;
    flows.variance = load_strided(gradients.variances + row, 1, count);
    Pack<T> velocities[3];
    load_rows<3>(gradients.velocities + 3 * row, count, velocities);
    for (int i = 0; i < 3; ++i) flows.add_velocity(of, i, velocities[i]);
    const T* const covariances = gradients.covariances + 9 * row;
    for (int a = 0; a < 3; ++a) {
      Pack<T> symmetric[3];
      for (int b = 0; b < 3; ++b) {
        symmetric[b] = load_strided(covariances + 3 * a + b, 9, count) +
                       load_strided(covariances + 3 * b + a, 9, count);
      }
      for (int j = 0; j < 4; ++j) {
        Pack<T> flow = symmetric[0] * of.factor(0, j);
        for (int b = 1; b < 3; ++b) flow = fma(symmetric[b], of.factor(b, j), flow);
        flows.add_factor(of, a, j, flow);
      }
    }
    flows.finish(of);
    Pack<T> left[4], right[4];
    for (int k = 0; k < 4; ++k) left[k] = right[k] = Pack<T>(0.0);
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        for (int k = 0; k < 4; ++k) {
          const Signed from = LEFT_ROWS[i][k], to = RIGHT_COLUMNS[j][k];
          const Pack<T> flow = from.sign * to.sign > 0 ? flows.rotation[i][j]
                                                       : -flows.rotation[i][j];
          left[from.of] = fma(flow, of.right[to.of], left[from.of]);
          right[to.of] = fma(flow, of.left[from.of], right[to.of]);
        }
      }
    }
    through_norm(of.left, of.left_inverse, left);
    through_norm(of.right, of.right_inverse, right);
    store_rows<4>(gradients.left + 4 * row, count, left);
    store_rows<4>(gradients.right + 4 * row, count, right);
    store_rows<4>(gradients.scales + 4 * row, count, flows.scales);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
