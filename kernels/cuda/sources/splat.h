// Splat: one row of the model, read by the thread that projects it.
#pragma once

#include "stages.h"

#include "projection.h"

namespace gsfw {
namespace cuda {

/// Threads per block of the kernels that project. Spherical harmonics of degree 4 in double need
/// 600 bytes of shared memory per thread, of which a block has 48 KB.
constexpr int PROJECT_THREADS = 64;

/// Smaller opacities count as this, whose logarithm is finite.
constexpr double OPACITY_MIN = 7.888609052210118e-31;

/// Row ``row`` of an array [n, 3].
template <class T>
GSFW_FUNCTION Vector3<T> load_vector(const void* array, int64 row) {
  const T* from = static_cast<const T*>(array) + row * 3;
  return {from[0], from[1], from[2]};
}

/// The shape of a row, in the form that ``shape`` has.
template <class T>
GSFW_FUNCTION void load_shape(const SplatArrays& splats, int64 row, Axes<T>& shape) {
  const T* q = static_cast<const T*>(splats.quats) + row * 4;
  shape.rotation = {q[0], q[1], q[2], q[3]};
  shape.scales = load_vector<T>(splats.scales, row);
}

/// Load the symmetric part of a covariance; its projection depends on nothing else.
template <class T>
GSFW_FUNCTION void load_shape(const SplatArrays& splats, int64 row, Symmetric3<T>& shape) {
  const T* c = static_cast<const T*>(splats.covariances) + row * 9;
  const T half(0.5);
  shape = {c[0], half * (c[1] + c[3]), half * (c[2] + c[6]), c[4], half * (c[5] + c[7]), c[8]};
}

/// A Gaussian before its projection.
template <class T, class Shape>
struct Splat {
  /// In scene units.
  Vector3<T> mean;
  Shape shape;
  /// In [0, 1], not compensated yet.
  T opacity;
};

template <class T, class Shape>
GSFW_FUNCTION Splat<T, Shape> load_splat(const SplatArrays& splats, int64 row) {
  Splat<T, Shape> splat;
  splat.mean = load_vector<T>(splats.means, row);
  load_shape(splats, row, splat.shape);
  splat.opacity = static_cast<const T*>(splats.opacities)[row];
  return splat;
}

}  // namespace cuda
}  // namespace gsfw
