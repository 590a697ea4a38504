// Blend, backward: from the gradient of an image to the sums that each splat's gradient is made of.
//
// One warp takes one chunk of one tile's splats, whose checkpoint holds the pixels' state in front
// of it; every chunk can be taken at once (the buckets of Taming 3DGS, Mallick et al. 2024). It
// works subtile by subtile, on the splats that reach it, a group of 16 at a time, in two roles.
// First a thread is a pixel: it goes through the group from the front, which gives every alpha and
// weight, and then from the back. With w = alpha T and p = sum over channels of colour times
// gradient, let B be what the pixel's gradient sees behind a splat, as if nothing were in front of
// it: then
//
//     alpha dL/d alpha = w (p - B),    and in front of the splat    B' = B + alpha (p - B),
//
// so that nothing is divided by 1 - alpha or by T. Then a thread is a splat, and sums over half of
// the pixels what these left in shared memory: no reduction across threads, no atomics but one per
// splat, chunk and number. B behind a chunk comes from the next checkpoint and the final image; it
// is the only quotient, once per pixel and chunk.
#include "tile.h"

namespace gsfw {
namespace cuda {

/// Splats that are taken together; two threads sum for each.
constexpr int GROUP = 16;
/// A row of 32 pixels and one more number, so that a column lies in as many banks.
constexpr int PIXEL_ROW = WARP + 1;

/// Memory shared by a chunk's warp.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
struct ChunkMemory {
  /// Sums per splat; an odd number of them, so that a field's column lies in different banks.
  static constexpr int FIELDS = SUM_CHANNELS + CHANNELS + (ABSOLUTE ? 2 : 0);
  static constexpr int SUM_STRIDE = FIELDS | 1;

  Entries<T, CHANNELS, CHUNK> entries;
  T sums[CHUNK][SUM_STRIDE];
  /// Per splat of the group and pixel: weight, and alpha dL/d alpha.
  T weights[GROUP][PIXEL_ROW];
  T pulls[GROUP][PIXEL_ROW];
  /// Gradient of each pixel's channels.
  T gradient[CHANNELS][WARP];
  /// Transmittance of each pixel in front of each group.
  T ahead[CHUNK / GROUP][WARP];
  /// Splats of the chunk that reach the subtile, from front to back.
  uint8 list[CHUNK];
};

/// Which chunk a warp has.
struct ChunkPlace {
  int tile;
  /// Its number in the tile, and the row of the checkpoint behind it.
  int chunk;
  int64 next;
  /// First pair, pairs, and pairs of the tile before it.
  int64 first;
  int count;
  int before;
  bool last;
};

/// The chunk of warp ``item``: the first chunk of each tile, then those with a checkpoint.
/// ``count`` is 0 where there is none.
template <int CHUNK>
__device__ __forceinline__ ChunkPlace place_of(const BlendJob& job, int64 item) {
  const int64 tiles = int64(job.grid.columns) * job.grid.rows;
  ChunkPlace place{};
  place.tile = item < tiles ? int(item) : job.chunk_tiles[item - tiles];
  if (place.tile < 0) return place;
  const int64 row = job.chunk_starts[place.tile];
  place.chunk = item < tiles ? 0 : int(item - tiles - row) + 1;
  place.next = row + place.chunk;
  place.before = place.chunk * CHUNK;
  place.first = job.tile_starts[place.tile] + place.before;
  const int64 rest = job.tile_starts[place.tile + 1] - place.first;
  place.count = int(rest < CHUNK ? rest : CHUNK);
  place.last = rest <= CHUNK;
  return place;
}

/// List the splats of a chunk that reach a subtile, as far as any pixel has seen; returns how many.
template <class T, int CHANNELS, int CHUNK>
__device__ __forceinline__ int list_splats(const Entries<T, CHANNELS, CHUNK>& entries, int subtile,
                                           int count, uint8* list) {
  int length = 0;
  for (int base = 0; base < count; base += WARP) {
    const int own = base + lane_index();
    const bool reached = own < count && (entries.subtiles[own] >> subtile & 1);
    const uint32 hits = __ballot_sync(FULL_WARP, int(reached));
    if (reached) list[length + __popc(hits & lanes_before())] = uint8(own);
    length += __popc(hits);
  }
  __syncwarp();
  return length;
}

/// Gradient of a pixel times the colour behind the chunk, per unit of transmittance.
template <class T, int CHANNELS>
__device__ __forceinline__ T behind_chunk(const BlendBackwardJob& job, const ChunkPlace& place,
                                          const Pixel<T>& at, int subtile, bool stopped,
                                          const T* gradient) {
  const BlendJob& forward = job.forward;
  const T* by_alpha = static_cast<const T*>(job.alpha_gradient);
  const T alpha_gradient = by_alpha ? by_alpha[at.index] : T(0);
  T total = -alpha_gradient;
  if (stopped) {
    const T* background = static_cast<const T*>(forward.background);
#pragma unroll
    for (int c = 0; c < CHANNELS; ++c) {
      if (c < forward.channels) total = fma(background[c], gradient[c], total);
    }
    return total;
  }
  const T* state =
      checkpoint_of<T, CHANNELS>(forward, place.next, subtile * WARP + lane_index());
  const T* image = static_cast<const T*>(forward.image) + at.index * forward.channels;
  total = -(static_cast<const T*>(forward.left)[at.index] * alpha_gradient);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) {
    if (c < forward.channels) {
      total = fma(image[c] - state[(1 + c) * TILE_PIXELS], gradient[c], total);
    }
  }
  return total / state[0];
}

/// Transmittance in front of each group but the first, into ``ahead``.
template <class T, class Memory>
__device__ __forceinline__ void replay(const BlendJob& job, Memory& memory, const Pixel<T>& at,
                                       int seen, int length, T transmittance) {
  const T level_min = T(job.level_min), cap = T(job.alpha_cap);
  for (int k = 0; k < length; ++k) {
    if (k % GROUP == 0) memory.ahead[k / GROUP][lane_index()] = transmittance;
    if (k / GROUP == (length - 1) / GROUP) break;
    const int entry = memory.list[k];
    const T alpha = alpha_at(memory.entries.splats[entry], at.x, at.y, level_min, cap);
    if (entry < seen) transmittance = transmittance * (T(1) - alpha);
  }
}

/// A thread is a pixel: leave weights and pulls of a group's splats, and move ``behind`` in front.
template <class T, int CHANNELS, class Memory>
__device__ __forceinline__ void backward_group(const BlendJob& job, Memory& memory,
                                              const Pixel<T>& at, int seen, int begin, int members,
                                              const T* gradient, T& behind) {
  const T level_min = T(job.level_min), cap = T(job.alpha_cap), limit = T(job.alpha_limit);
  const int lane = lane_index();
  T alphas[GROUP], weights[GROUP];
  T transmittance = memory.ahead[begin / GROUP][lane];
#pragma unroll
  for (int k = 0; k < GROUP; ++k) {
    alphas[k] = weights[k] = T(0);
    if (k < members) {
      const int entry = memory.list[begin + k];
      const T alpha = alpha_at(memory.entries.splats[entry], at.x, at.y, level_min, cap);
      alphas[k] = entry < seen ? alpha : T(0);
      weights[k] = alphas[k] * transmittance;
      transmittance = transmittance * (T(1) - alphas[k]);
    }
  }
#pragma unroll
  for (int k = GROUP - 1; k >= 0; --k) {
    if (k < members) {
      const T* color = memory.entries.splats[memory.list[begin + k]] + BLEND_CHANNELS;
      T pull = T(0);
#pragma unroll
      for (int c = 0; c < CHANNELS; ++c) pull = fma(color[c], gradient[c], pull);
      const T lift = pull - behind;
      memory.weights[k][lane] = weights[k];
      memory.pulls[k][lane] = alphas[k] <= limit ? weights[k] * lift : T(0);
      behind = fma(alphas[k], lift, behind);
    }
  }
}

/// Sums over the pixels of one splat.
template <class T, int CHANNELS>
struct SplatSums {
  T shape[SUM_CHANNELS];
  T channel[CHANNELS];
  T magnitude[2];
};

/// A thread is a splat: sum over the half of the subtile's pixels that is the thread's.
template <class T, int CHANNELS, bool ABSOLUTE, class Memory>
__device__ __forceinline__ void sum_pixels(const Memory& memory, int subtile, const T* splat,
                                           SplatSums<T, CHANNELS>& sums) {
  const int member = lane_index() % GROUP, half = lane_index() / GROUP * GROUP;
#pragma unroll 4
  for (int i = 0; i < GROUP; ++i) {
    const T g = memory.pulls[member][half + i], weight = memory.weights[member][half + i];
    const Vector2<T> z =
        whitened_at(splat, pixel_x<T>(subtile, half + i), pixel_y<T>(subtile, half + i));
    const T gu = g * z.x, gv = g * z.y;
    sums.shape[SUM_G] += g;
    sums.shape[SUM_U] += gu;
    sums.shape[SUM_V] += gv;
    sums.shape[SUM_UU] = fma(gu, z.x, sums.shape[SUM_UU]);
    sums.shape[SUM_UV] = fma(gu, z.y, sums.shape[SUM_UV]);
    sums.shape[SUM_VV] = fma(gv, z.y, sums.shape[SUM_VV]);
    if (ABSOLUTE) {
      sums.magnitude[0] += absolute(fma(splat[BLEND_R], gu, splat[BLEND_WK] * gv));
      sums.magnitude[1] += absolute(splat[BLEND_W] * gv);
    }
#pragma unroll
    for (int c = 0; c < CHANNELS; ++c) {
      sums.channel[c] = fma(weight, memory.gradient[c][half + i], sums.channel[c]);
    }
  }
}

/// Add the two halves of a splat's sums to what its earlier subtiles gave.
template <class T, int CHANNELS, bool ABSOLUTE>
__device__ __forceinline__ void add_halves(const SplatSums<T, CHANNELS>& sums, bool own, T* to) {
  const auto add = [&](int field, T value) {
    const T both = value + __shfl_xor_sync(FULL_WARP, value, GROUP);
    if (own) to[field] += both;
  };
#pragma unroll
  for (int k = 0; k < SUM_CHANNELS; ++k) add(k, sums.shape[k]);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) add(SUM_CHANNELS + c, sums.channel[c]);
  if (ABSOLUTE) {
    add(SUM_CHANNELS + CHANNELS, sums.magnitude[0]);
    add(SUM_CHANNELS + CHANNELS + 1, sums.magnitude[1]);
  }
}

/// One subtile of a chunk.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
__device__ __forceinline__ void backward_subtile(
    const BlendBackwardJob& job, const ChunkPlace& place, int subtile,
    ChunkMemory<T, CHANNELS, CHUNK, ABSOLUTE>& memory) {
  const BlendJob& forward = job.forward;
  const int lane = lane_index();
  const Pixel<T> at = pixel_of<T>(forward.grid, place.tile, subtile, lane);
  const int seen = at.inside ? forward.seen[at.index] - place.before : 0;
  if (!__any_sync(FULL_WARP, int(seen > 0))) return;
  const int length = list_splats(memory.entries, subtile, place.count, memory.list);
  if (length == 0) return;
  T gradient[CHANNELS];
  const T* from = static_cast<const T*>(job.image_gradient) + at.index * forward.channels;
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) {
    gradient[c] = at.inside && c < forward.channels ? from[c] : T(0);
    memory.gradient[c][lane] = gradient[c];
  }
  T transmittance = T(1), behind = T(0);
  if (seen > 0) {
    const bool stopped = place.last || seen <= place.count;
    behind = behind_chunk<T, CHANNELS>(job, place, at, subtile, stopped, gradient);
    if (place.chunk > 0) {
      transmittance = *checkpoint_of<T, CHANNELS>(forward, place.next - 1, subtile * WARP + lane);
    }
  }
  replay(forward, memory, at, seen, length, transmittance);
  for (int begin = (length - 1) / GROUP * GROUP; begin >= 0; begin -= GROUP) {
    const int members = length - begin < GROUP ? length - begin : GROUP;
    backward_group<T, CHANNELS>(forward, memory, at, seen, begin, members, gradient, behind);
    __syncwarp();
    SplatSums<T, CHANNELS> sums{};
    const int member = lane % GROUP;
    const int entry = memory.list[begin + (member < members ? member : 0)];
    if (member < members) {
      sum_pixels<T, CHANNELS, ABSOLUTE>(memory, subtile, memory.entries.splats[entry], sums);
    }
    add_halves<T, CHANNELS, ABSOLUTE>(sums, member < members && lane < GROUP, memory.sums[entry]);
    __syncwarp();
  }
}

/// Hand a chunk's sums on: to the pairs' own rows, or to those of the splats.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
__device__ __forceinline__ void write_sums(
    const BlendBackwardJob& job, const ChunkPlace& place,
    const ChunkMemory<T, CHANNELS, CHUNK, ABSOLUTE>& memory) {
  const BlendJob& forward = job.forward;
  constexpr int FIELDS = SUM_CHANNELS + CHANNELS + (ABSOLUTE ? 2 : 0);
  // Neighbouring threads take neighbouring numbers of one splat, which share a line of memory.
  for (int item = lane_index(); item < place.count * FIELDS; item += WARP) {
    const int entry = item / FIELDS, k = item % FIELDS;
    // Padding up to CHANNELS is left out, lest it take the place of the magnitudes.
    const bool magnitude = k >= SUM_CHANNELS + CHANNELS;
    if (k >= SUM_CHANNELS + forward.channels && !magnitude) continue;
    const int64 pair = place.first + entry;
    const int64 row = forward.slots ? forward.slots[pair] : forward.rows[pair];
    T* to = static_cast<T*>(job.sums) + row * job.sum_stride +
            (magnitude ? k - CHANNELS + forward.channels : k);
    const T value = memory.sums[entry][k];
    if (forward.slots) {
      *to = value;
    } else if (value != T(0)) {
      atomicAdd(to, value);
    }
  }
}

/// One block, which is one warp, per chunk: ``tiles + chunks`` of them.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
__global__ void __launch_bounds__(WARP) blend_backward(BlendBackwardJob job) {
  __shared__ ChunkMemory<T, CHANNELS, CHUNK, ABSOLUTE> memory;
  const ChunkPlace place = place_of<CHUNK>(job.forward, blockIdx.x);
  for (int entry = lane_index(); entry < place.count; entry += WARP) {
    load_entry(job.forward, place.tile, place.first, entry, memory.entries);
#pragma unroll
    for (int k = 0; k < memory.SUM_STRIDE; ++k) memory.sums[entry][k] = T(0);
  }
  __syncwarp();
  for (int subtile = 0; subtile < SUBTILES && place.count > 0; ++subtile) {
    backward_subtile<T, CHANNELS, CHUNK, ABSOLUTE>(job, place, subtile, memory);
  }
  __syncwarp();
  write_sums(job, place, memory);
}

}  // namespace cuda
}  // namespace gsfw
