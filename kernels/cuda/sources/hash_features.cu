// Features of a multi-resolution hash grid in place and time, and the gradients of its tables.
//
// Mueller et al. 2022, "Instant Neural Graphics Primitives", section 3, in four dimensions: rows of
// a table are interpolated linearly among the sixteen corners of a cell. Corners have rows of their
// own where the table is large enough, and share them by a hash (equation 4) elsewhere. A thread
// has some channels of one table at one place; neighbouring threads have all those of the place.
// Gradients of rows are added by atomics, in no order.
#include "field_stages.h"

namespace gsfw {
namespace cuda {

constexpr int HASH_AXES = 4, HASH_PLACE = 3, HASH_CORNERS = 1 << HASH_AXES;

/// Channels that are read at once.
template <class T, int WIDTH>
struct alignas(sizeof(T) * WIDTH) Channels {
  T at[WIDTH];
};

/// The cell of a coordinate in [0, 1] among ``corners`` corners; NaN counts as 0.
template <class T>
__device__ __forceinline__ int cell_between(T coordinate, int corners, T& weight) {
  const T x = coordinate > T(0.0) ? (coordinate < T(1.0) ? coordinate : T(1.0)) : T(0.0);
  const T place = x * T(corners - 1);
  const int low = int(place) < corners - 2 ? int(place) : corners - 2;
  weight = place - T(low);
  return low;
}

/// What a thread has: ``WIDTH`` channels of one table, at one place.
template <int WIDTH>
struct HashShare {
  /// Groups of ``WIDTH`` channels: of a table; this one among those of its table, and among all.
  uint32 groups, of_table, group;
  int64 row;
  int level;

  __device__ __forceinline__ explicit HashShare(const HashJob& job)
      : groups(uint32(job.channels / WIDTH)), group(uint32(thread_index())) {
    const uint32 of_place = uint32(job.level_count) * groups, place = group / of_place;
    const uint32 within = group - place * of_place;
    row = place;
    level = int(within / groups);
    of_table = within - uint32(level) * groups;
  }
};

/// The cell of a place in one table: parts of the rows of its corners, and their weights.
template <class T>
struct HashCell {
  uint32 parts[HASH_AXES][2];
  T weights[HASH_AXES][2];
  uint32 mask;
  bool dense;

  __device__ __forceinline__ HashCell(const HashJob& job, const HashLevel& level, int64 row)
      : mask(uint32(level.rows) - 1u), dense(level.dense != 0) {
    // Products of the hash are right in their lower bits, of which a table has no more than 31.
    constexpr uint32 primes[HASH_AXES] = {1u, 2654435761u, 805459861u, 3674653429u};
    const T* const place = static_cast<const T*>(job.places) + row * HASH_PLACE;
    uint32 stride = 1u;
#pragma unroll
    for (int axis = 0; axis < HASH_AXES; ++axis) {
      const bool space = axis < HASH_PLACE;
      const int corners = space ? level.side : level.times;
      const T coordinate =
          space ? (place[axis] + T(1.0)) / T(2.0) : *static_cast<const T*>(job.time);
      const int low = cell_between(coordinate, corners, weights[axis][1]);
      weights[axis][0] = T(1.0) - weights[axis][1];
      const uint32 factor = dense ? stride : primes[axis];
      parts[axis][0] = uint32(low) * factor;
      parts[axis][1] = parts[axis][0] + factor;
      stride *= uint32(corners);
    }
  }

  /// Row of the table for a corner, one bit for each axis.
  __device__ __forceinline__ uint32 row(int corner) const {
    const uint32 x = parts[0][corner & 1], y = parts[1][corner >> 1 & 1];
    const uint32 z = parts[2][corner >> 2 & 1], t = parts[3][corner >> 3 & 1];
    return dense ? x + y + z + t : (x ^ y ^ z ^ t) & mask;
  }

  __device__ __forceinline__ T weight(int corner) const {
    return weights[0][corner & 1] * weights[1][corner >> 1 & 1] *
           (weights[2][corner >> 2 & 1] * weights[3][corner >> 3 & 1]);
  }
};

/// Add to channels that begin at a multiple of their size.
template <class T, int WIDTH>
__device__ __forceinline__ void add_channels(Channels<T, WIDTH>* to,
                                             const Channels<T, WIDTH>& more) {
#pragma unroll
  for (int c = 0; c < WIDTH; ++c) atomicAdd(to->at + c, more.at[c]);
}

#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
// From this architecture on one instruction adds all of them.
__device__ __forceinline__ void add_channels(Channels<float, 4>* to,
                                             const Channels<float, 4>& more) {
  asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};" ::"l"(__cvta_generic_to_global(to)),
               "f"(more.at[0]), "f"(more.at[1]), "f"(more.at[2]), "f"(more.at[3])
               : "memory");
}
__device__ __forceinline__ void add_channels(Channels<float, 2>* to,
                                             const Channels<float, 2>& more) {
  asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(__cvta_generic_to_global(to)),
               "f"(more.at[0]), "f"(more.at[1])
               : "memory");
}
#endif

/// See ``HashJob``. Blocks of HASH_THREADS, one thread for every ``WIDTH`` channels of a place.
template <class T, int WIDTH>
__global__ void __launch_bounds__(HASH_THREADS) hash_features(HashJob job) {
  const HashShare<WIDTH> share(job);
  if (share.row >= job.count) return;
  const HashLevel& level = job.levels[share.level];
  const HashCell<T> cell(job, level, share.row);
  const auto* const table = static_cast<const Channels<T, WIDTH>*>(level.table) + share.of_table;
  Channels<T, WIDTH> sum = {};
#pragma unroll
  for (int corner = 0; corner < HASH_CORNERS; ++corner) {
    const Channels<T, WIDTH> from = table[int64(cell.row(corner)) * share.groups];
    const T weight = cell.weight(corner);
#pragma unroll
    for (int c = 0; c < WIDTH; ++c) sum.at[c] = fma(weight, from.at[c], sum.at[c]);
  }
  static_cast<Channels<T, WIDTH>*>(job.features)[share.group] = sum;
}

/// See ``HashBackwardJob``. Blocks as in the forward pass. Channels without a gradient add nothing.
template <class T, int WIDTH>
__global__ void __launch_bounds__(HASH_THREADS) hash_features_backward(HashBackwardJob job) {
  const HashShare<WIDTH> share(job.forward);
  if (share.row >= job.forward.count || job.tables[share.level] == nullptr) return;
  const T* const arriving = static_cast<const T*>(job.gradient) + int64(share.group) * WIDTH;
  T flow[WIDTH];
  bool any = false;
#pragma unroll
  for (int c = 0; c < WIDTH; ++c) {
    flow[c] = arriving[c];
    any = any || flow[c] != T(0.0);
  }
  if (!any) return;
  const HashCell<T> cell(job.forward, job.forward.levels[share.level], share.row);
  auto* const table = static_cast<Channels<T, WIDTH>*>(job.tables[share.level]) + share.of_table;
#pragma unroll
  for (int corner = 0; corner < HASH_CORNERS; ++corner) {
    const T weight = cell.weight(corner);
    Channels<T, WIDTH> more;
#pragma unroll
    for (int c = 0; c < WIDTH; ++c) more.at[c] = weight * flow[c];
    add_channels(table + int64(cell.row(corner)) * share.groups, more);
  }
}

}  // namespace cuda
}  // namespace gsfw
