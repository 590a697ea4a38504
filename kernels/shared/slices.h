// Slices of Gaussians of space and time: covariance, velocity and temporal variance, and gradients.
//
// As gsfw.core.maths.slices has it, which gives the equations (Duan et al. 2024; Yang et al. 2024)
// and says why nothing cancels.
#pragma once

#include "number.h"

namespace gsfw {
namespace GSFW_ISA {

/// Components of a quaternion w, x, y, z, and axes x, y, z, t; those of space; entries of a
/// covariance.
constexpr int AXES = 4, SPACE_AXES = 3, COVARIANCE_ENTRIES = SPACE_AXES * SPACE_AXES;
/// Least norm of a quaternion, below which it counts as the identity; least variance of the time.
constexpr double LEAST_NORM = 1e-12, LEAST_VARIANCE = 1e-30;

/// A component of a quaternion with a sign.
struct Signed {
  int of;
  double sign;
};

/// Entry (i, k) of the matrix of x -> q x, for points x, y, z, t. The tables are static because GCC
/// does not look into others, and takes three times as long.
GSFW_FUNCTION Signed left_entry(int i, int k) {
  static constexpr Signed rows[AXES][AXES] = {{{0, 1}, {3, -1}, {2, 1}, {1, 1}},
                                       {{3, 1}, {0, 1}, {1, -1}, {2, 1}},
                                       {{2, -1}, {1, 1}, {0, 1}, {3, 1}},
                                       {{1, -1}, {2, -1}, {3, -1}, {0, 1}}};
  return rows[i][k];
}

/// Entry (k, j) of the matrix of x -> x conj(q).
GSFW_FUNCTION Signed right_entry(int k, int j) {
  static constexpr Signed columns[AXES][AXES] = {{{0, 1}, {3, 1}, {2, -1}, {1, 1}},
                                          {{3, -1}, {0, 1}, {1, 1}, {2, 1}},
                                          {{2, 1}, {1, -1}, {0, 1}, {3, 1}},
                                          {{1, -1}, {2, -1}, {3, -1}, {0, 1}}};
  return columns[j][k];
}

template <class T>
GSFW_FUNCTION T component(const T* quat, Signed at) {
  return at.sign > 0 ? quat[at.of] : -quat[at.of];
}

/// Divide a quaternion by its norm; returns one over the norm, or 0 where it counts as the
/// identity, as one of NaN does.
template <class T>
GSFW_FUNCTION T normalise(T* quat) {
  const T zero(0.0), one(1.0);
  T size = zero;
  GSFW_UNROLL
  for (int k = 0; k < AXES; ++k) size = maximum(size, absolute(quat[k]));
  Mask<T> there = size > T(LEAST_NORM);
  GSFW_UNROLL
  for (int k = 0; k < AXES; ++k) there = there & (quat[k] <= quat[k]);
  const T scale = select(there, size, one);
  T square(0.0);
  GSFW_UNROLL
  for (int k = 0; k < AXES; ++k) {
    quat[k] = select(there, quat[k] / scale, k == 0 ? one : zero);
    square = fma(quat[k], quat[k], square);
  }
  const T norm = square_root(square);
  GSFW_UNROLL
  for (int k = 0; k < AXES; ++k) quat[k] = quat[k] / norm;
  return keep(there, one / (norm * scale));
}

/// Gradient of a quaternion before it was normalised, from that of the normalised one.
template <class T>
GSFW_FUNCTION void through_norm(const T* quat, const T& inverse, T* gradient) {
  T along = quat[0] * gradient[0];
  GSFW_UNROLL
  for (int k = 1; k < AXES; ++k) along = fma(quat[k], gradient[k], along);
  GSFW_UNROLL
  for (int k = 0; k < AXES; ++k) gradient[k] = fma_negated(along, quat[k], gradient[k]) * inverse;
}

/// What is known of a Gaussian of space and time: quaternions of any norm, and scales.
template <class T>
struct SpaceTime {
  T left[AXES], right[AXES], scales[AXES];
};

/// A slice, with everything that both passes need.
template <class T>
struct Slice {
  /// Quaternions of norm 1, and one over the norms before.
  SpaceTime<T> source;
  T left_inverse, right_inverse;
  /// Its last row has the components of each axis along time.
  T rotation[AXES][AXES];
  T pulls[AXES], variance, inverse;
  Mask<T> long_enough;
  /// Sum over k of (row_j time_k - row_k time_j) pull_k.
  T pulled[SPACE_AXES][AXES];

  GSFW_FUNCTION explicit Slice(const SpaceTime<T>& given) : source(given) {
    left_inverse = normalise(source.left);
    right_inverse = normalise(source.right);
    GSFW_UNROLL
    for (int i = 0; i < AXES; ++i) {
      GSFW_UNROLL
      for (int j = 0; j < AXES; ++j) {
        T total = component(source.left, left_entry(i, 0)) *
                  component(source.right, right_entry(0, j));
        GSFW_UNROLL
        for (int k = 1; k < AXES; ++k) {
          // GCC does not unroll this for AVX2 if a factor has a name, and takes twice as long.
          total = fma(component(source.left, left_entry(i, k)),
                      component(source.right, right_entry(k, j)), total);
        }
        rotation[i][j] = total;
      }
    }
    const T* const time = rotation[SPACE_AXES];
    T sum(0.0);
    GSFW_UNROLL
    for (int k = 0; k < AXES; ++k) {
      pulls[k] = source.scales[k] * source.scales[k] * time[k];
      sum = fma(time[k] * source.scales[k], time[k] * source.scales[k], sum);
    }
    long_enough = sum >= T(LEAST_VARIANCE);
    variance = maximum(T(LEAST_VARIANCE), sum);  // NaN stays NaN.
    inverse = T(1.0) / variance;
    GSFW_UNROLL
    for (int i = 0; i < SPACE_AXES; ++i) {
      GSFW_UNROLL
      for (int j = 0; j < AXES; ++j) {
        T total(0.0);
        GSFW_UNROLL
        for (int k = 0; k < AXES; ++k) {
          if (k != j) total = fma(turned(i, j, k), pulls[k], total);
        }
        pulled[i][j] = total;
      }
    }
  }

  /// row_j time_k - row_k time_j, of row i.
  GSFW_FUNCTION T turned(int i, int j, int k) const {
    const T* const time = rotation[SPACE_AXES];
    return rotation[i][j] * time[k] - rotation[i][k] * time[j];
  }

  /// Entry of the factor P of the covariance P P^T.
  GSFW_FUNCTION T factor(int i, int j) const { return pulled[i][j] * (source.scales[j] * inverse); }

  GSFW_FUNCTION T covariance(int a, int b) const {
    T total = factor(a, 0) * factor(b, 0);
    GSFW_UNROLL
    for (int j = 1; j < AXES; ++j) total = fma(factor(a, j), factor(b, j), total);
    return total;
  }

  GSFW_FUNCTION T velocity(int i) const {
    T total = rotation[i][0] * pulls[0];
    GSFW_UNROLL
    for (int k = 1; k < AXES; ++k) total = fma(rotation[i][k], pulls[k], total);
    return total * inverse;
  }
};

/// Gradients of a slice's rotation, pulls, scales and variance, which are added up.
template <class T>
struct SliceFlows {
  T rotation[AXES][AXES], pulls[AXES], scales[AXES], variance;

  /// From the gradient of the variance.
  GSFW_FUNCTION explicit SliceFlows(const T& of_variance) : variance(of_variance) {
    GSFW_UNROLL
    for (int i = 0; i < AXES; ++i) {
      pulls[i] = scales[i] = T(0.0);
      GSFW_UNROLL
      for (int j = 0; j < AXES; ++j) rotation[i][j] = T(0.0);
    }
  }

  /// From the gradients of row ``a`` of the covariance and of column ``a``, added.
  GSFW_FUNCTION void add_covariance(const Slice<T>& of, int a, const T* symmetric) {
    GSFW_UNROLL
    for (int j = 0; j < AXES; ++j) {
      T flow = symmetric[0] * of.factor(0, j);
      GSFW_UNROLL
      for (int b = 1; b < SPACE_AXES; ++b) flow = fma(symmetric[b], of.factor(b, j), flow);
      add_factor(of, a, j, flow);
    }
  }

  /// From the gradient of velocity i.
  GSFW_FUNCTION void add_velocity(const Slice<T>& of, int i, const T& gradient) {
    const T flow = gradient * of.inverse;
    GSFW_UNROLL
    for (int k = 0; k < AXES; ++k) {
      rotation[i][k] = fma(flow, of.pulls[k], rotation[i][k]);
      pulls[k] = fma(flow, of.rotation[i][k], pulls[k]);
    }
    variance = variance - flow * of.velocity(i);
  }

  /// Gradients of quaternions of any norm and of scales.
  GSFW_FUNCTION SpaceTime<T> finish(const Slice<T>& of) {
    through_pulls(of);
    SpaceTime<T> to;
    GSFW_UNROLL
    for (int k = 0; k < AXES; ++k) {
      to.left[k] = to.right[k] = T(0.0);
      to.scales[k] = scales[k];
    }
    GSFW_UNROLL
    for (int i = 0; i < AXES; ++i) {
      GSFW_UNROLL
      for (int j = 0; j < AXES; ++j) {
        GSFW_UNROLL
        for (int k = 0; k < AXES; ++k) {
          const Signed l = left_entry(i, k), r = right_entry(k, j);
          const T flow = l.sign * r.sign > 0 ? rotation[i][j] : -rotation[i][j];
          to.left[l.of] = fma(flow, of.source.right[r.of], to.left[l.of]);
          to.right[r.of] = fma(flow, of.source.left[l.of], to.right[r.of]);
        }
      }
    }
    through_norm(of.source.left, of.left_inverse, to.left);
    through_norm(of.source.right, of.right_inverse, to.right);
    return to;
  }

 private:
  /// From the gradient of factor (i, j).
  GSFW_FUNCTION void add_factor(const Slice<T>& of, int i, int j, const T& gradient) {
    T* const time = rotation[SPACE_AXES];
    const T* const of_time = of.rotation[SPACE_AXES];
    const T by_scale = gradient * of.pulled[i][j] * of.inverse;
    scales[j] = scales[j] + by_scale;
    variance = variance - by_scale * (of.source.scales[j] * of.inverse);
    const T flow = gradient * (of.source.scales[j] * of.inverse);
    GSFW_UNROLL
    for (int k = 0; k < AXES; ++k) {
      if (k == j) continue;
      const T pulled = flow * of.pulls[k];
      rotation[i][j] = fma(pulled, of_time[k], rotation[i][j]);
      rotation[i][k] = fma_negated(pulled, of_time[j], rotation[i][k]);
      time[k] = fma(pulled, of.rotation[i][j], time[k]);
      time[j] = fma_negated(pulled, of.rotation[i][k], time[j]);
      pulls[k] = fma(flow, of.turned(i, j, k), pulls[k]);
    }
  }

  /// From pulls and variance to scales and to the row of time.
  GSFW_FUNCTION void through_pulls(const Slice<T>& of) {
    const T twice = keep(of.long_enough, variance + variance);
    GSFW_UNROLL
    for (int k = 0; k < AXES; ++k) {
      const T scale = of.source.scales[k], time = of.rotation[SPACE_AXES][k];
      T& to = rotation[SPACE_AXES][k];
      to = fma(fma(twice, time, pulls[k]), scale * scale, to);
      scales[k] = fma(fma(twice, time, pulls[k] + pulls[k]), scale * time, scales[k]);
    }
  }
};

}  // namespace GSFW_ISA
}  // namespace gsfw
