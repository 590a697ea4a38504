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

/// Splats of more slots than this are summed by a whole warp.
constexpr int SLOTS_BY_ONE_LANE = 16;

/// Sum ``count`` slots into the first of them, always in the same order. A warp collective.
template <class T>
__device__ __forceinline__ void fold_slots(T* first, int count, int stride) {
  for (int field = 0; field < stride; ++field) {
    T total = T(0);
    for (int i = lane_index(); i < count; i += WARP) total += first[int64(i) * stride + field];
    total = warp_sum(total);
    if (lane_index() == 0) first[field] = total;
  }
}

/// The sums of this thread's row. A warp collective: splats with many slots are summed by the whole
/// warp, one after the other, lest one lane keep 31 waiting.
template <class T>
__device__ __forceinline__ SlotSums<T> sums_of(const ProjectBackwardJob& job, int64 row,
                                               bool visible) {
  T* sums = static_cast<T*>(job.sums);
  if (!job.slot_ends) return {sums + row * job.sum_stride, visible ? 1 : 0, job.sum_stride};
  int count = visible ? job.forward.tile_counts[row] : 0;
  const int64 first = visible ? job.slot_ends[row] - count : 0;
  const bool many = count > SLOTS_BY_ONE_LANE;
  for (uint32 left = __ballot_sync(FULL_WARP, many); left != 0; left &= left - 1) {
    const int lane = __ffs(int(left)) - 1;
    T* slots = sums + __shfl_sync(FULL_WARP, first, lane) * job.sum_stride;
    fold_slots(slots, __shfl_sync(FULL_WARP, count, lane), job.sum_stride);
  }
  __syncwarp();
  if (many) count = 1;
  return {sums + first * job.sum_stride, count, job.sum_stride};
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
