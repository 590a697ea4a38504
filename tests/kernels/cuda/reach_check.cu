// Reach check: what project.cu and blend.cu ask reach.h, as kernels of their own.
#include "reach.h"

namespace gsfw {
namespace cuda {

struct ReachJob {
  Grid grid;
  int bounded;
  int stride;
  int64 count;
  /// T [n, stride]
  const void* projected;
  /// [n]
  const uint8* visible;
  /// int32 [n]
  int* tile_counts;
  /// int32 [n, tiles]
  int* subtiles;
};

/// One thread per splat.
template <class T>
__global__ void __launch_bounds__(64) count_all(ReachJob job) {
  const int64 row = thread_index();
  const bool visible = row < job.count && job.visible[row];
  const T* from = static_cast<const T*>(job.projected) + (visible ? row * job.stride : 0);
  T splat[SPLAT_CHANNELS];
#pragma unroll
  for (int i = 0; i < SPLAT_CHANNELS; ++i) splat[i] = visible ? from[i] : T(0);
  const int tiles = count_tiles(splat, visible, job.grid, job.bounded != 0);
  if (row < job.count) job.tile_counts[row] = tiles;
}

/// One thread per splat and tile.
template <class T>
__global__ void __launch_bounds__(64) find_subtiles(ReachJob job) {
  const int tiles = job.grid.columns * job.grid.rows;
  const int64 row = thread_index() / tiles;
  if (row >= job.count || !job.visible[row]) return;
  const int tile = int(thread_index() % tiles);
  const T* splat = static_cast<const T*>(job.projected) + row * job.stride;
  job.subtiles[thread_index()] =
      int(subtiles_reached(splat, tile % job.grid.columns * TILE, tile / job.grid.columns * TILE,
                       job.bounded != 0));
}

}  // namespace cuda
}  // namespace gsfw
