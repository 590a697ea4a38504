// Gradients: where a thread writes those of its row, and what blending left for it to start from.
#pragma once

#include "stages.h"

#include "ellipse.h"

namespace gsfw {
namespace cuda {

/// The sums of one splat over its pixels: those of its slots, always added in the same order, or
/// those of its one row.
template <class T>
struct SlotSums {
  const T* first;
  /// Slots, or 1 row; 0 where the splat is not visible, whose sums are zeros.
  int count;
  int stride;

  /// ``COUNT`` sums from ``field`` on.
  template <int COUNT>
  GSFW_FUNCTION void add_up(int field, T* totals) const {
#pragma unroll
    for (int k = 0; k < COUNT; ++k) totals[k] = T(0);
    for (int i = 0; i < count; ++i) {
      const T* slot = first + int64(i) * stride + field;
#pragma unroll
      for (int k = 0; k < COUNT; ++k) totals[k] += slot[k];
    }
  }

  GSFW_FUNCTION T operator[](int field) const {
    T total;
    add_up<1>(field, &total);
    return total;
  }
};

template <class T>
GSFW_FUNCTION SlotSums<T> sums_of(const ProjectBackwardJob& job, int64 row, bool visible) {
  int64 first = row;
  int count = visible ? 1 : 0;
  if (visible && job.slot_ends) {
    count = job.forward.tile_counts[row];
    first = job.slot_ends[row] - count;
  }
  return {static_cast<const T*>(job.sums) + first * job.sum_stride, count, job.sum_stride};
}

/// Writes gradients of one row, or adds to them.
struct GradientWriter {
  int64 row;
  /// False for threads without a row, and where there is nothing to add.
  bool writes;
  bool add;

  /// ``COUNT`` numbers of an array [n, stride] from ``field`` on, if there is an array.
  template <int COUNT, class T>
  GSFW_FUNCTION void write(void* array, int stride, int field, const T* gradient) const {
    if (!array || !writes) return;
    T* to = static_cast<T*>(array) + row * stride + field;
#pragma unroll
    for (int k = 0; k < COUNT; ++k) to[k] = add ? to[k] + gradient[k] : gradient[k];
  }

  template <class T>
  GSFW_FUNCTION void write(void* array, const Vector3<T>& gradient) const {
    const T numbers[3] = {gradient.x, gradient.y, gradient.z};
    write<3>(array, 3, 0, numbers);
  }

  template <class T>
  GSFW_FUNCTION void write_shape(const SplatGradients& to, const Axes<T>& gradient) const {
    const Quaternion<T>& q = gradient.rotation;
    const T numbers[4] = {q.w, q.x, q.y, q.z};
    write<4>(to.quats, 4, 0, numbers);
    write(to.scales, gradient.scales);
  }

  template <class T>
  GSFW_FUNCTION void write_shape(const SplatGradients& to, const Symmetric3<T>& gradient) const {
    const T numbers[9] = {gradient.xx, gradient.xy, gradient.xz, gradient.xy, gradient.yy,
                          gradient.yz, gradient.xz, gradient.yz, gradient.zz};
    write<9>(to.covariances, 9, 0, numbers);
  }
};

}  // namespace cuda
}  // namespace gsfw
