// Blend: alpha-composite the splats of each tile, from front to back.
//
// Kerbl et al. 2023, equation 3. One block blends one tile, each of its warps a subtile of 8 x 4
// pixels: a warp passes over a chunk's splats 32 at a time and looks only at those that reach its
// own subtile. In front of every chunk but the first, each pixel's state is kept for the backward
// pass, which can then begin anywhere.
#include "tile.h"

namespace gsfw {
namespace cuda {

/// No splat reaches this level: the logarithm of alpha is at most 0.
constexpr double CLOSED = 1e30;

/// State of one pixel during blending.
template <class T, int CHANNELS>
struct PixelState {
  T transmittance;
  T color[CHANNELS];
  /// log2 of the least alpha that is rendered; CLOSED once the pixel is opaque and outside the
  /// image. A closed pixel goes on with splats whose alpha is 0: cheaper than asking each time.
  T level_min;
  /// Pairs of the tile that it has looked at before it stopped.
  int seen;
};

/// Keep a pixel's state in front of a chunk.
template <class T, int CHANNELS>
__device__ __forceinline__ void save_checkpoint(const BlendJob& job, int64 row, int tile,
                                                const PixelState<T, CHANNELS>& pixel) {
  T* to = checkpoint_of<T, CHANNELS>(job, row, int(threadIdx.x));
  to[0] = pixel.transmittance;
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) to[(1 + c) * TILE_PIXELS] = pixel.color[c];
  if (threadIdx.x == 0) job.chunk_tiles[row] = tile;
}

template <class T, int CHANNELS>
__device__ __forceinline__ bool sees_through(const PixelState<T, CHANNELS>& pixel) {
  return pixel.level_min < T(CLOSED);
}

/// Blend one splat; returns its weight. ``place`` is its number among the pairs of the tile.
template <class T, int CHANNELS>
__device__ __forceinline__ T blend_splat(const T* color, T alpha, int place, T stop,
                                         PixelState<T, CHANNELS>& pixel) {
  // A splat that would make the pixel opaque is not rendered, nor is any behind. That is selected,
  // not branched to: a warp is done only when the last of its pixels is.
  const T next = pixel.transmittance * (T(1) - alpha);
  const bool opens = next > stop;
  const T weight = opens ? alpha * pixel.transmittance : T(0);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) pixel.color[c] = fma(weight, color[c], pixel.color[c]);
  if (opens) pixel.transmittance = next;
  if (!opens) pixel.level_min = T(CLOSED);
  if (!opens) pixel.seen = place;
  return weight;
}

/// Weight of a pixel in the contributions.
template <class T>
__device__ __forceinline__ T pixel_weight_at(const BlendJob& job, const Pixel<T>& at) {
  return job.pixel_weights && at.inside ? static_cast<const T*>(job.pixel_weights)[at.index] : T(1);
}

/// Blend a chunk on one subtile. ``weights`` [CHUNK] takes each splat's sum over the subtile, of
/// weights times ``pixel_weight``, if ``MEASURE``; those that are not blended keep what is there.
template <class T, int CHANNELS, int CHUNK, bool MEASURE>
__device__ __forceinline__ void blend_chunk(const BlendJob& job,
                                            const Entries<T, CHANNELS, CHUNK>& entries, int before,
                                            int count, const Pixel<T>& at,
                                            T pixel_weight, PixelState<T, CHANNELS>& pixel,
                                            T* weights) {
  const T cap = pinned<T>(job.alpha_cap), stop = pinned<T>(job.transmittance_min);
  for (int base = 0; base < count; base += WARP) {
    if (!__any_sync(FULL_WARP, int(sees_through(pixel)))) return;
    const int own = base + lane_index();
    const uint32 reached = own < count ? entries.subtiles[own] : 0u;
    // The highest bit is the first splat: one instruction finds it, where the lowest takes two.
    uint32 hits = __brev(__ballot_sync(FULL_WARP, int(reached >> warp_index() & 1u)));
    while (hits) {
      const int bit = WARP - 1 - __clz(int(hits)), place = base + WARP - 1 - bit;
      hits ^= 1u << bit;
      const T* splat = entries.splats[place];
      const T alpha = alpha_at(splat, at.x, at.y, pixel.level_min, cap);
      const T weight = blend_splat(splat + entries.COLOR, alpha, before + place, stop, pixel);
      if constexpr (MEASURE) {
        const T total = warp_sum(weight * pixel_weight);
        if (lane_index() == 0) weights[place] = total;
      }
    }
  }
}

/// Add up what the subtiles measured of each splat, always in the same order.
template <class T, int CHUNK>
__device__ __forceinline__ void record_contribution(const BlendJob& job, int64 first, int count,
                                                    const T (*weights)[CHUNK]) {
  T* contribution = static_cast<T*>(job.contribution);
  for (int place = int(threadIdx.x); place < count; place += TILE_PIXELS) {
    T total = T(0);
    for (int s = 0; s < SUBTILES; ++s) total += weights[s][place];
    if (job.slots) {
      contribution[job.slots[first + place]] = total;
    } else if (total != T(0)) {
      atomicAdd(contribution + job.rows[first + place], total);
    }
  }
}

/// Put the background behind a pixel, and write it.
template <class T, int CHANNELS>
__device__ __forceinline__ void finish_pixel(const BlendJob& job, const Pixel<T>& at,
                                             const PixelState<T, CHANNELS>& pixel) {
  if (!at.inside) return;
  const T left = pixel.transmittance;
  static_cast<T*>(job.alpha)[at.index] = T(1) - left;
  if (job.left) static_cast<T*>(job.left)[at.index] = left;
  if (job.seen) job.seen[at.index] = pixel.seen;
  T* image = static_cast<T*>(job.image) + at.index * job.channels;
  const T* background = static_cast<const T*>(job.background);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) {
    if (c < job.channels) image[c] = fma(left, background[c], pixel.color[c]);
  }
}

/// Blocks that are to fit on a multiprocessor at once, which bounds their registers: told less, the
/// compiler takes so few for RGB that it spills.
template <class T, int CHANNELS>
constexpr int RESIDENT_BLOCKS = sizeof(T) > 4 ? 1 : CHANNELS > 8 ? 2 : CHANNELS > 4 ? 3 : 4;

/// One block of 256 threads per tile; ``CHUNK`` is a multiple of 32.
template <class T, int CHANNELS, int CHUNK, bool MEASURE>
__global__ void __launch_bounds__(TILE_PIXELS, RESIDENT_BLOCKS<T, CHANNELS>)
    blend(BlendJob job) {
  __shared__ Entries<T, CHANNELS, CHUNK> entries;
  __shared__ T weights[SUBTILES][MEASURE ? CHUNK : 1];
  const int tile = int(blockIdx.x);
  const Pixel<T> at = pixel_of<T>(job.grid, tile, warp_index(), lane_index());
  const T pixel_weight = MEASURE ? pixel_weight_at<T>(job, at) : T(1);
  PixelState<T, CHANNELS> pixel;
  pixel.transmittance = T(1);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) pixel.color[c] = T(0);
  pixel.level_min = at.inside ? T(job.level_min) : T(CLOSED);
  pixel.seen = 0;
  const int64 begin = job.tile_starts[tile], end = job.tile_starts[tile + 1];
  int64 checkpoint = job.checkpoints ? job.chunk_starts[tile] : 0;
  for (int64 first = begin; first < end; first += CHUNK) {
    // Nobody may still read the last chunk when this one comes in.
    if (!__syncthreads_or(int(sees_through(pixel)))) break;
    const int count = int(end - first < CHUNK ? end - first : CHUNK);
    if (job.checkpoints && first > begin) {
      save_checkpoint(job, checkpoint++, tile, pixel);
    }
    for (int place = int(threadIdx.x); place < count; place += TILE_PIXELS) {
      load_entry(job, tile, first, place, entries);
    }
    if constexpr (MEASURE) {
      for (int place = lane_index(); place < count; place += WARP) {
        weights[warp_index()][place] = T(0);
      }
    }
    __syncthreads();
    blend_chunk<T, CHANNELS, CHUNK, MEASURE>(job, entries, int(first - begin), count, at,
                                             pixel_weight, pixel, weights[warp_index()]);
    if constexpr (MEASURE) {
      __syncthreads();
      record_contribution<T>(job, first, count, weights);
    }
  }
  if (sees_through(pixel)) pixel.seen = int(end - begin);
  finish_pixel(job, at, pixel);
}

}  // namespace cuda
}  // namespace gsfw
