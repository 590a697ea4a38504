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
  const void* brushes;
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
  const int64 splat = thread_index();
  const bool visible = splat < job.count && job.visible[splat];
  const T* from = static_cast<const T*>(job.brushes) + (visible ? splat * job.stride : 0);
  T brush[BRUSH_CHANNELS];
#pragma unroll
  for (int i = 0; i < BRUSH_CHANNELS; ++i) brush[i] = visible ? from[i] : T(0);
  const int tiles = count_tiles(brush, visible, job.grid, job.bounded != 0);
  if (splat < job.count) job.tile_counts[splat] = tiles;
}

/// One thread per splat and tile.
template <class T>
__global__ void __launch_bounds__(64) find_subtiles(ReachJob job) {
  const int tiles = job.grid.columns * job.grid.rows;
  const int64 splat = thread_index() / tiles;
  if (splat >= job.count || !job.visible[splat]) return;
  const int tile = int(thread_index() % tiles);
  const T* brush = static_cast<const T*>(job.brushes) + splat * job.stride;
  job.subtiles[thread_index()] =
      int(subtiles_met(brush, tile % job.grid.columns * TILE, tile / job.grid.columns * TILE,
                       job.bounded != 0));
}

}  // namespace cuda
}  // namespace gsfw
