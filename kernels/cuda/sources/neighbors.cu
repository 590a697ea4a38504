// Nearest points of every point, by the distances of all pairs.
//
// The work grows with the square of their number, but not the waiting: 360,000 points have 1.3e11
// pairs of some ten instructions each. A thread keeps the nearest of one point in registers; the
// points of all others pass through shared memory, which a block reads once.
#include "step_stages.h"

namespace gsfw {
namespace cuda {

/// Put a point among the nearest, which are in order; of equal distances, the first found is nearer.
template <class T, int WIDTH>
__device__ __forceinline__ void insert(T distance, int row, T (&distances)[WIDTH],
                                       int (&rows)[WIDTH]) {
#pragma unroll
  for (int i = 0; i < WIDTH; ++i) {
    if (distance < distances[i]) {
      const T farther = distances[i];
      const int other = rows[i];
      distances[i] = distance;
      rows[i] = row;
      distance = farther;
      row = other;
    }
  }
}

/// See ``NeighborsJob``.
template <class T, int AXES, int WIDTH>
__global__ void __launch_bounds__(NEIGHBOR_THREADS) neighbors(NeighborsJob job) {
  __shared__ T others[NEIGHBOR_THREADS][AXES];
  const T* points = static_cast<const T*>(job.points);
  const int row = job.first + int(thread_index()), thread = int(threadIdx.x);
  T own[AXES], distances[WIDTH];
  int rows[WIDTH];
#pragma unroll
  for (int axis = 0; axis < AXES; ++axis) {
    own[axis] = row < job.end ? points[int64(row) * AXES + axis] : T(0.0);
  }
#pragma unroll
  for (int i = 0; i < WIDTH; ++i) {
    distances[i] = T(1.0) / T(0.0);
    rows[i] = row;
  }
  for (int from = 0; from < job.count; from += NEIGHBOR_THREADS) {
    const int rest = job.count - from, there = rest < NEIGHBOR_THREADS ? rest : NEIGHBOR_THREADS;
    __syncthreads();
#pragma unroll
    for (int axis = 0; axis < AXES; ++axis) {
      if (thread < there) others[thread][axis] = points[int64(from + thread) * AXES + axis];
    }
    __syncthreads();
    for (int i = 0; i < there; ++i) {
      T distance = T(0.0);
#pragma unroll
      for (int axis = 0; axis < AXES; ++axis) {
        const T apart = others[i][axis] - own[axis];
        distance = fma(apart, apart, distance);
      }
      if (distance < distances[WIDTH - 1] && from + i != row) {
        insert(distance, from + i, distances, rows);
      }
    }
  }
  if (row >= job.end) return;
#pragma unroll
  for (int i = 0; i < WIDTH; ++i) {
    if (i < job.wanted) job.rows[int64(row) * job.wanted + i] = rows[i];
  }
}

}  // namespace cuda
}  // namespace gsfw
