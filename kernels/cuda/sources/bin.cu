// Bin: one pair for every splat and tile that intersect, and where each tile's pairs begin.
//
// A warp emits for 32 splats that follow each other in depth, whose pairs therefore follow each
// other in memory. It deals out first their rows of tiles, one to a lane, and then the pairs of
// these 32 rows, one to a lane, so that all lanes have work however unlike the splats are, and
// write side by side.
#include "look_back.h"
#include "reach.h"

namespace gsfw {
namespace cuda {

/// Sums the tile counts from front to back; one thread per COUNTS_PER_THREAD places in the order.
template <class Count>
__global__ void __launch_bounds__(BIN_THREADS) sum_counts(CountsJob job) {
  const int block = take_number(job.next);
  const int64 first = (int64(block) * BIN_THREADS + int(threadIdx.x)) * COUNTS_PER_THREAD;
  int splats[COUNTS_PER_THREAD];
  int64 ends[COUNTS_PER_THREAD], sum = 0;
#pragma unroll
  for (int i = 0; i < COUNTS_PER_THREAD; ++i) {
    splats[i] = first + i < job.count ? job.order[first + i] : -1;
    sum += splats[i] < 0 ? Count(0) : static_cast<const Count*>(job.tile_counts)[splats[i]];
    ends[i] = sum;
  }
  const BlockSum<int64> of = block_sum<BIN_THREADS>(sum);
  const int64 before = sum_before_block(job.words, block, of.all) + of.before;
#pragma unroll
  for (int i = 0; i < COUNTS_PER_THREAD; ++i) {
    if (splats[i] < 0) break;
    job.ends[first + i] = before + ends[i];
    if (job.row_ends) job.row_ends[splats[i]] = before + ends[i];
    if (first + i == job.count - 1) *job.pairs = before + ends[i];
  }
}

/// The lane that has number ``item`` where lane i has those from ``ends`` of lane i - 1 up to its
/// own; the last lane for numbers beyond. A warp collective; lanes may ask for different numbers.
__device__ __forceinline__ int lane_of(int item, int ends) {
  int lane = 0;
#pragma unroll
  for (int half = WARP / 2; half > 0; half /= 2) {
    if (__shfl_sync(FULL_WARP, ends, lane + half - 1) <= item) lane += half;
  }
  return lane;
}

/// The splat of one lane.
template <class T>
struct Emitter {
  int splat;
  Ellipse<T> ellipse;
  TileRange rows;
};

/// Splats that intersect no tile, and threads beyond the last splat, have no rows.
template <class T>
__device__ __forceinline__ Emitter<T> emitter_of(const EmitJob& job, int splat, int count) {
  Emitter<T> emitter{splat, {}, {0, -1}};
  if (count == 0) return emitter;
  if (!job.bounded) {
    emitter.rows.last = job.grid.rows - 1;
    return emitter;
  }
  const T* projected = static_cast<const T*>(job.projected);
  emitter.ellipse = ellipse_of(projected + int64(splat) * job.stride);
  emitter.rows = tile_rows(emitter.ellipse, job.grid);
  return emitter;
}

/// Some columns of one row of tiles, and the splat that intersects them.
struct TileRow {
  int splat, row;
  TileRange columns;
};

/// Row number ``item`` of those that the lanes have together, ``ends`` being the last of each
/// lane's and one more. A warp collective.
template <class T>
__device__ __forceinline__ TileRow tile_row(const EmitJob& job, const Emitter<T>& own, int item,
                                            int ends) {
  const int lane = lane_of(item, ends);
  const Ellipse<T> ellipse = from_lane(own.ellipse, lane);
  const int row = __shfl_sync(FULL_WARP, own.rows.last + 1 - ends, lane) + item;
  TileRow found{__shfl_sync(FULL_WARP, own.splat, lane), row, {0, job.grid.columns - 1}};
  if (job.bounded) found.columns = tile_columns(ellipse, row, job.grid);
  return found;
}

template <class Key>
__device__ __forceinline__ void write_pair(const EmitJob& job, int64 place, int tile, int splat) {
  static_cast<Key*>(job.tiles)[place] = Key(tile);
  job.payload[place] = job.numbered ? int(place) : splat;
  if (job.numbered) job.rows[place] = splat;
}

/// Writes the pairs of 32 rows, one from each lane, from place ``begin`` on; returns how many. A
/// warp collective.
template <class Key>
__device__ __forceinline__ int emit_rows(const EmitJob& job, const TileRow& own, int64 begin) {
  const int ends = warp_running_sum(length(own.columns));
  const int pairs = __shfl_sync(FULL_WARP, ends, WARP - 1);
  const int64 left = job.room - begin;
  const int written = left < 0 ? 0 : left < pairs ? int(left) : pairs;
  const int first_tile = own.row * job.grid.columns + own.columns.last + 1 - ends;
  for (int base = 0; base < pairs; base += WARP) {
    const int pair = base + lane_index();
    const int lane = lane_of(pair, ends);
    const int tile = __shfl_sync(FULL_WARP, first_tile, lane) + pair;
    const int splat = __shfl_sync(FULL_WARP, own.splat, lane);
    if (pair < written) write_pair<Key>(job, begin + pair, tile, splat);
  }
  return pairs;
}

/// Writes the pairs of the splats from front to back, and of each splat by row of tiles and then by
/// column; one thread per splat.
template <class T, class Key>
__global__ void __launch_bounds__(BIN_THREADS, sizeof(T) > 4 ? 4 : 6) emit(EmitJob job) {
  const int64 place = thread_index();
  const int splat = place < job.count ? job.order[place] : 0;
  const int count = place < job.count ? job.tile_counts[splat] : 0;
  const Emitter<T> own = emitter_of<T>(job, splat, count);
  // Splats without pairs between others change nothing, as ends do not move there.
  int64 begin = place < job.count ? job.ends[place] - count : 0;
  begin = __shfl_sync(FULL_WARP, begin, 0);
  const int ends = warp_running_sum(length(own.rows));
  const int rows = __shfl_sync(FULL_WARP, ends, WARP - 1);
  for (int base = 0; base < rows; base += WARP) {
    const int item = base + lane_index();
    TileRow row = tile_row(job, own, item, ends);
    if (item >= rows) row.columns = {0, -1};
    begin += emit_rows<Key>(job, row, begin);
  }
}

/// Finds by bisection the first pair of a tile or of a later one.
template <class Key>
__device__ __forceinline__ int64 first_pair(const TilesJob& job, int64 tile) {
  const Key* tiles = static_cast<const Key*>(job.tiles);
  int64 low = 0, high = count_of(job);
  while (low < high) {
    const int64 middle = (low + high) / 2;
    if (int64(tiles[middle]) < tile) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

/// One thread per tile and one for the end.
template <class Key>
__global__ void __launch_bounds__(BIN_THREADS) find_tiles(TilesJob job) {
  __shared__ int64 starts[BIN_THREADS + 1];
  const int block = take_number(job.next), thread = threadIdx.x;
  const int64 tile = int64(block) * BIN_THREADS + thread;
  starts[thread] = first_pair<Key>(job, tile);
  if (thread == 0) starts[BIN_THREADS] = first_pair<Key>(job, tile + BIN_THREADS);
  __syncthreads();
  const int64 start = starts[thread], pairs = starts[thread + 1] - start;
  const bool has_further = tile < job.num_tiles && pairs > 0;
  const int64 further = has_further ? (pairs - 1) / job.chunk : 0;
  const BlockSum<int64> of = block_sum<BIN_THREADS>(further);
  const int64 before = sum_before_block(job.words, block, of.all) + of.before;
  if (tile <= job.num_tiles) {
    job.starts[tile] = start;
    job.chunk_starts[tile] = before;
  }
  const int64 stride = int64(gridDim.x) * BIN_THREADS;
  for (int64 i = tile; i < job.chunks; i += stride) job.chunk_tiles[i] = -1;
}

}  // namespace cuda
}  // namespace gsfw
