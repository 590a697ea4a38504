// Products of the features of six planes at places, and their gradients.
//
// Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering", section 4.2: three
// planes of space, xy, xz and yz, are interpolated bilinearly, and three of space and time, read at
// one time beforehand, linearly; features are multiplied channel by channel. A warp has one place
// and its lanes the channels of all resolutions, one after another, so that it reads whole lines of
// memory. Gradients of cells are added by atomics, in no order.
#include "field_stages.h"

namespace gsfw {
namespace cuda {

constexpr int PLANES = 3, FACTORS = 2 * PLANES;

/// Axes of plane p.
__device__ __forceinline__ constexpr int first_axis(int p) { return p == 2 ? 1 : 0; }
__device__ __forceinline__ constexpr int second_axis(int p) { return p == 0 ? 1 : 2; }

/// A cell along one axis, the weights of its two corners, and the cells per unit of the coordinate.
template <class T>
struct Cell {
  int at;
  T low, high, slope;
};

template <class T>
__device__ __forceinline__ Cell<T> cell_of(T coordinate, int side) {
  // NaN counts as -1: it may be no index. Beyond the border values are constant.
  const bool inside = coordinate >= T(-1.0) && coordinate <= T(1.0);
  const T x = coordinate > T(-1.0) ? (coordinate < T(1.0) ? coordinate : T(1.0)) : T(-1.0);
  const T half = T(side - 1) / T(2.0), place = (x + T(1.0)) * half;
  const int at = int(place) < side - 2 ? int(place) : side - 2;
  const T high = place - T(at);
  return {at, T(1.0) - high, high, inside ? half : T(0.0)};
}

/// One channel of one resolution at a place: where the corners of its cells lie.
template <class T>
struct Corners {
  Cell<T> cells[PLANES];
  int level, channels, next_row;
  int plane_at[PLANES], line_at[PLANES];

  /// ``feature`` counts the channels of all resolutions.
  __device__ __forceinline__ Corners(const PlaneProductJob& job, const T* place, int feature)
      : level(int(uint32(feature) / uint32(job.channels))), channels(job.channels) {
    const int side = job.levels[level].side, channel = feature - level * channels;
    next_row = side * channels;
#pragma unroll
    for (int k = 0; k < PLANES; ++k) cells[k] = cell_of(place[k], side);
#pragma unroll
    for (int k = 0; k < PLANES; ++k) {
      const int row = k * side + cells[first_axis(k)].at;
      plane_at[k] = (row * side + cells[second_axis(k)].at) * channels + channel;
      line_at[k] = (k * side + cells[k].at) * channels + channel;
    }
  }
};

/// An interpolated factor and its derivatives by the coordinates within the cell.
template <class T>
struct PlaneValue {
  T value, by_first, by_second;
};

template <class T>
__device__ __forceinline__ PlaneValue<T> plane_value(const Corners<T>& at, const void* planes,
                                                     int k) {
  const Cell<T>&first = at.cells[first_axis(k)], &second = at.cells[second_axis(k)];
  const T* const from = static_cast<const T*>(planes) + at.plane_at[k];
  const T a = from[0], b = from[at.channels];
  const T d = from[at.next_row], e = from[at.next_row + at.channels];
  const T above = fma(second.high, b, second.low * a), below = fma(second.high, e, second.low * d);
  return {fma(first.high, below, first.low * above), below - above,
          fma(first.high, e - d, first.low * (b - a))};
}

template <class T>
struct LineValue {
  T value, slope;
};

template <class T>
__device__ __forceinline__ LineValue<T> line_value(const Corners<T>& at, const void* lines, int k) {
  const T* const from = static_cast<const T*>(lines) + at.line_at[k];
  const T a = from[0], b = from[at.channels];
  return {fma(at.cells[k].high, b, at.cells[k].low * a), b - a};
}

/// The place of this thread's warp; it may lie beyond the last.
__device__ __forceinline__ int64 row_of_warp() { return thread_index() / WARP; }

/// See ``PlaneProductJob``. Every block has PLANE_THREADS, every warp a place.
template <class T>
__global__ void __launch_bounds__(PLANE_THREADS) plane_product(PlaneProductJob job) {
  const int64 row = row_of_warp();
  if (row >= job.count) return;
  const int features = job.level_count * job.channels;
  const T* const place = static_cast<const T*>(job.places) + row * PLANES;
  T* const to = static_cast<T*>(job.features) + row * features;
  for (int feature = lane_index(); feature < features; feature += WARP) {
    const Corners<T> at(job, place, feature);
    const PlaneLevel& level = job.levels[at.level];
    T product = T(job.scale);
#pragma unroll
    for (int k = 0; k < PLANES; ++k) {
      product *= plane_value(at, level.planes, k).value * line_value(at, level.lines, k).value;
    }
    to[feature] = product;
  }
}

/// Gradients of the six factors, each ``gradient`` times the other five, and by the place.
template <class T>
struct PlaneFlows {
  T planes[PLANES], lines[PLANES], place[PLANES];

  __device__ __forceinline__ PlaneFlows(const Corners<T>& at, const PlaneLevel& level, T gradient) {
    PlaneValue<T> plane[PLANES];
    LineValue<T> line[PLANES];
    T pairs[PLANES];
#pragma unroll
    for (int k = 0; k < PLANES; ++k) {
      plane[k] = plane_value(at, level.planes, k);
      line[k] = line_value(at, level.lines, k);
      pairs[k] = plane[k].value * line[k].value;
    }
    const T others[PLANES] = {gradient * (pairs[1] * pairs[2]), gradient * (pairs[0] * pairs[2]),
                              gradient * (pairs[0] * pairs[1])};
#pragma unroll
    for (int k = 0; k < PLANES; ++k) {
      planes[k] = others[k] * line[k].value;
      lines[k] = others[k] * plane[k].value;
      place[k] = lines[k] * line[k].slope;
    }
#pragma unroll
    for (int k = 0; k < PLANES; ++k) {
      place[first_axis(k)] = fma(planes[k], plane[k].by_first, place[first_axis(k)]);
      place[second_axis(k)] = fma(planes[k], plane[k].by_second, place[second_axis(k)]);
    }
  }
};

/// Add the gradients of the six factors to their planes and lines.
template <class T>
__device__ __forceinline__ void scatter(const Corners<T>& at, const PlaneFlows<T>& flows,
                                        const PlaneGradients& level) {
#pragma unroll
  for (int k = 0; k < PLANES; ++k) {
    if (level.planes) {
      const Cell<T>&first = at.cells[first_axis(k)], &second = at.cells[second_axis(k)];
      T* const plane = static_cast<T*>(level.planes) + at.plane_at[k];
      const T above = first.low * flows.planes[k], below = first.high * flows.planes[k];
      atomicAdd(plane, second.low * above);
      atomicAdd(plane + at.channels, second.high * above);
      atomicAdd(plane + at.next_row, second.low * below);
      atomicAdd(plane + at.next_row + at.channels, second.high * below);
    }
    if (level.lines) {
      T* const line = static_cast<T*>(level.lines) + at.line_at[k];
      atomicAdd(line, at.cells[k].low * flows.lines[k]);
      atomicAdd(line + at.channels, at.cells[k].high * flows.lines[k]);
    }
  }
}

/// True if any of the features of this warp's place has a gradient. A warp collective.
template <class T>
__device__ __forceinline__ bool has_gradient(const T* gradient, int features) {
  bool found = false;
  for (int feature = lane_index(); feature < features; feature += WARP) {
    found = found || gradient[feature] != T(0.0);
  }
  return __any_sync(FULL_WARP, found);
}

/// See ``PlaneProductBackwardJob``. Every block has PLANE_THREADS, every warp a place. Those
/// without a gradient (no pixel shows them) read and add nothing.
template <class T>
__global__ void __launch_bounds__(PLANE_THREADS)
    plane_product_backward(PlaneProductBackwardJob job) {
  const PlaneProductJob& of = job.forward;
  const int64 row = row_of_warp();
  if (row >= of.count) return;
  const int features = of.level_count * of.channels;
  const T* const place = static_cast<const T*>(of.places) + row * PLANES;
  const T* const gradient = static_cast<const T*>(job.gradient) + row * features;
  T moved[PLANES] = {};
  if (has_gradient(gradient, features)) {
    for (int feature = lane_index(); feature < features; feature += WARP) {
      const Corners<T> at(of, place, feature);
      const PlaneFlows<T> flows(at, of.levels[at.level], gradient[feature] * T(of.scale));
      scatter(at, flows, job.levels[at.level]);
#pragma unroll
      for (int k = 0; k < PLANES; ++k) moved[k] = fma(flows.place[k], at.cells[k].slope, moved[k]);
    }
  }
  if (job.places == nullptr) return;
#pragma unroll
  for (int k = 0; k < PLANES; ++k) {
    const T total = warp_sum(moved[k]);
    if (lane_index() == k) static_cast<T*>(job.places)[row * PLANES + k] = total;
  }
}

}  // namespace cuda
}  // namespace gsfw
