// Blend, backward: from the gradient of an image to the sums that each splat's gradient is made of.
//
// One block takes one chunk of one tile's splats, whose checkpoint holds the pixels' state in front
// of it; every chunk can be taken at once (the buckets of Taming 3DGS, Mallick et al. 2024). A warp
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
/// Splats between two questions whether there are more. A list of splats is filled up to a multiple
/// with splats whose alpha is 0, and as many of its entries fill the number that one load fetches.
constexpr int STEP = sizeof(uint32);
/// A row of 32 pixels and one more, so that a column lies in as many banks.
constexpr int PIXEL_ROW = WARP + 1;

/// Level of a splat that no pixel sees.
constexpr double UNSEEN = -1e30;

/// What one pixel leaves for one splat: weight, and alpha dL/d alpha.
template <class T>
struct __align__(2 * sizeof(T)) Share {
  T weight, pull;
};

/// Memory of one warp.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
struct WarpMemory {
  /// Sums per splat; an odd number of them, so that a field's column lies in different banks.
  static constexpr int FIELDS = SUM_CHANNELS + CHANNELS + (ABSOLUTE ? 2 : 0);
  static constexpr int SUM_STRIDE = FIELDS | 1;
  static constexpr int COLOR_STRIDE = CHANNELS > 2 ? whole_fours(CHANNELS) : CHANNELS;

  /// Gradient of each pixel's channels.
  __align__(16) T gradient[WARP][COLOR_STRIDE];
  Share<T> shares[GROUP][PIXEL_ROW];
  T sums[CHUNK][SUM_STRIDE];
  /// Transmittance of each pixel in front of each group.
  T ahead[CHUNK / GROUP][WARP];
  /// Splats of the chunk that reach the subtile, from front to back: a byte for each.
  uint32 list[CHUNK / STEP];
};

/// Which chunk a block has.
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

/// Memory of a block.
template <class T, int CHANNELS, int CHUNK, int THREADS, bool ABSOLUTE>
struct ChunkMemory {
  /// Kept here once it is known, which leaves its registers to others.
  ChunkPlace place;
  /// The splats of the chunk, and one whose alpha is 0.
  Entries<T, CHANNELS, CHUNK + 1> entries;
  WarpMemory<T, CHANNELS, CHUNK, ABSOLUTE> warps[THREADS / WARP];
};

/// The chunk of block ``item``: the first chunk of each tile, then those with a checkpoint.
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

/// List the splats of a chunk that reach a subtile, and fill the list up; returns how many.
template <class T, int CHANNELS, int CHUNK>
__device__ __forceinline__ int list_splats(const Entries<T, CHANNELS, CHUNK + 1>& entries,
                                           int subtile, int count, uint32 (&list)[CHUNK / STEP]) {
  static_assert(CHUNK <= 255, "A byte holds the number of every splat, and CHUNK for none.");
  uint8* numbers = reinterpret_cast<uint8*>(list);
  int length = 0;
  for (int base = 0; base < count; base += WARP) {
    const int own = base + lane_index();
    const bool reached = own < count && (entries.subtiles[own] >> subtile & 1);
    const uint32 hits = __ballot_sync(FULL_WARP, int(reached));
    if (reached) numbers[length + __popc(hits & lanes_before())] = uint8(own);
    length += __popc(hits);
  }
  if (lane_index() < (STEP - length % STEP) % STEP) {
    numbers[length + lane_index()] = uint8(CHUNK);
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

/// The cut-offs of alpha, and the pairs of the chunk that the pixel has looked at.
template <class T>
struct Limits {
  T level_min, cap, smooth;
  int seen;
};

/// The splat that a list has at ``k``, of the four entries that were fetched.
__device__ __forceinline__ int entry_of(uint32 four, int k) {
  return int(four >> 8 * (k % STEP) & 255u);
}

/// Alpha of an entry at a pixel; 0 if the pixel has not looked at it.
template <class T, int CHANNELS, int CHUNK>
__device__ __forceinline__ T seen_alpha(const Entries<T, CHANNELS, CHUNK>& entries, int entry,
                                        const Pixel<T>& at, const Limits<T>& limits) {
  const T alpha = alpha_at(entries.splats[entry], at.x, at.y, limits.level_min, limits.cap);
  return entry < limits.seen ? alpha : T(0);
}

/// Transmittance in front of each group, into ``ahead``.
template <class T, class Entries, class Memory>
__device__ __forceinline__ void replay(const Entries& entries, Memory& memory, const Pixel<T>& at,
                                       const Limits<T>& limits, int length, T transmittance) {
  constexpr int STEPS = GROUP / STEP;
  const int last = (length - 1) / GROUP;
  for (int step = 0; step < last * STEPS; ++step) {
    if (step % STEPS == 0) memory.ahead[step / STEPS][lane_index()] = transmittance;
    const uint32 four = memory.list[step];
#pragma unroll
    for (int k = 0; k < STEP; ++k) {
      transmittance = transmittance * (T(1) - seen_alpha(entries, entry_of(four, k), at, limits));
    }
  }
  memory.ahead[last][lane_index()] = transmittance;
}

/// A thread is a pixel: leave its shares of a group's splats, and move ``behind`` in front.
template <class T, int CHANNELS, int CHUNK, class Memory>
__device__ __forceinline__ void backward_group(const Entries<T, CHANNELS, CHUNK>& entries,
                                               Memory& memory, const Pixel<T>& at,
                                               const Limits<T>& limits, int group, int members,
                                               const T* gradient, T& behind) {
  constexpr int STEPS = GROUP / STEP;
  const int lane = lane_index();
  T alphas[GROUP], weights[GROUP];
  uint32 fours[STEPS];
  T transmittance = memory.ahead[group][lane];
#pragma unroll
  for (int step = 0; step < STEPS; ++step) {
    if (step * STEP >= members) continue;
    fours[step] = memory.list[group * STEPS + step];
#pragma unroll
    for (int k = step * STEP; k < (step + 1) * STEP; ++k) {
      alphas[k] = seen_alpha(entries, entry_of(fours[step], k), at, limits);
      weights[k] = alphas[k] * transmittance;
      transmittance = transmittance * (T(1) - alphas[k]);
    }
  }
#pragma unroll
  for (int step = STEPS - 1; step >= 0; --step) {
    if (step * STEP >= members) continue;
#pragma unroll
    for (int k = (step + 1) * STEP - 1; k >= step * STEP; --k) {
      const T* color = entries.splats[entry_of(fours[step], k)] + entries.COLOR;
      T pull = T(0);
#pragma unroll
      for (int c = 0; c < CHANNELS; ++c) pull = fma(color[c], gradient[c], pull);
      const T lift = pull - behind;
      memory.shares[k][lane] = {weights[k], alphas[k] <= limits.smooth ? weights[k] * lift : T(0)};
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

/// Add the magnitudes that a pixel gives to the gradient of the mean, of which g u and g v are known.
template <class T>
__device__ __forceinline__ void add_magnitudes(const T* splat, T gu, T gv, T* magnitude) {
  magnitude[0] += absolute(fma(splat[BLEND_R], gu, splat[BLEND_WK] * gv));
  magnitude[1] += absolute(splat[BLEND_W] * gv);
}

/// A thread is a splat: sum over the half of the subtile's pixels that is the thread's: two rows,
/// one column after the other, since u is the same in all of a column.
template <class T, int CHANNELS, bool ABSOLUTE, class Memory>
__device__ __forceinline__ void sum_pixels(const Memory& memory, int subtile, const T* splat,
                                           SplatSums<T, CHANNELS>& sums) {
  static_assert(GROUP == 2 * SUBTILE_WIDTH, "Half of a subtile is two rows.");
  const int member = lane_index() % GROUP, half = lane_index() / GROUP * GROUP;
  const Vector2<T> corner =
      whitened_at(splat, pixel_x<T>(subtile, half), pixel_y<T>(subtile, half));
  // All columns at once would take registers that other warps need.
#pragma unroll(CHANNELS > 8 ? 1 : SUBTILE_WIDTH / 2)
  for (int i = 0; i < SUBTILE_WIDTH; ++i) {
    const int above = half + i, below = above + SUBTILE_WIDTH;
    const Share<T> first = memory.shares[member][above], second = memory.shares[member][below];
    const T u = fma(splat[BLEND_R], T(i), corner.x);
    const T v = fma(splat[BLEND_WK], T(i), corner.y), next_v = v + splat[BLEND_W];
    const T g = first.pull + second.pull, gu = g * u;
    const T first_gv = first.pull * v, second_gv = second.pull * next_v;
    const T gv = first_gv + second_gv;
    sums.shape[SUM_G] += g;
    sums.shape[SUM_U] += gu;
    sums.shape[SUM_V] += gv;
    sums.shape[SUM_UU] = fma(gu, u, sums.shape[SUM_UU]);
    sums.shape[SUM_UV] = fma(gv, u, sums.shape[SUM_UV]);
    sums.shape[SUM_VV] = fma(first_gv, v, fma(second_gv, next_v, sums.shape[SUM_VV]));
    if (ABSOLUTE) {
      add_magnitudes(splat, first.pull * u, first_gv, sums.magnitude);
      add_magnitudes(splat, second.pull * u, second_gv, sums.magnitude);
    }
#pragma unroll
    for (int c = 0; c < CHANNELS; ++c) {
      sums.channel[c] = fma(first.weight, memory.gradient[above][c], sums.channel[c]);
      sums.channel[c] = fma(second.weight, memory.gradient[below][c], sums.channel[c]);
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

/// What a pixel's walk over a chunk begins with.
template <class T>
struct Start {
  /// In front of the chunk.
  T transmittance;
  /// Gradient times what is behind the chunk.
  T behind;
};

/// Fetch the gradient of a pixel's channels, and find where its walk begins.
template <class T, int CHANNELS>
__device__ __forceinline__ Start<T> start_of(const BlendBackwardJob& job, const ChunkPlace& place,
                                             const Pixel<T>& at, int subtile, int seen,
                                             T* gradient) {
  const BlendJob& forward = job.forward;
  const T* from = static_cast<const T*>(job.image_gradient) + at.index * forward.channels;
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) {
    gradient[c] = at.inside && c < forward.channels ? from[c] : T(0);
  }
  if (seen <= 0) return {T(1), T(0)};
  const bool stopped = place.last || seen <= place.count;
  const T behind = behind_chunk<T, CHANNELS>(job, place, at, subtile, stopped, gradient);
  if (place.chunk == 0) return {T(1), behind};
  const int pixel = subtile * WARP + lane_index();
  return {*checkpoint_of<T, CHANNELS>(forward, place.next - 1, pixel), behind};
}

/// One subtile of a chunk.
template <class T, int CHANNELS, int CHUNK, bool ABSOLUTE>
__device__ __forceinline__ void backward_subtile(
    const BlendBackwardJob& job, const ChunkPlace& place, int subtile,
    const Entries<T, CHANNELS, CHUNK + 1>& entries,
    WarpMemory<T, CHANNELS, CHUNK, ABSOLUTE>& memory) {
  const BlendJob& forward = job.forward;
  const int lane = lane_index();
  const Pixel<T> at = pixel_of<T>(forward.grid, place.tile, subtile, lane);
  const int seen = at.inside ? forward.seen[at.index] - place.before : 0;
  if (!__any_sync(FULL_WARP, int(seen > 0))) return;
  const int length =
      list_splats<T, CHANNELS, CHUNK>(entries, subtile, place.count, memory.list);
  if (length == 0) return;
  const Limits<T> limits{pinned<T>(forward.level_min), pinned<T>(forward.alpha_cap),
                         pinned<T>(forward.alpha_limit), seen};
  T gradient[CHANNELS];
  const Start<T> start = start_of<T, CHANNELS>(job, place, at, subtile, seen, gradient);
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) memory.gradient[lane][c] = gradient[c];
  replay(entries, memory, at, limits, length, start.transmittance);
  T behind = start.behind;
  for (int group = (length - 1) / GROUP; group >= 0; --group) {
    const int rest = length - group * GROUP, members = rest < GROUP ? rest : GROUP;
    backward_group(entries, memory, at, limits, group, members, gradient, behind);
    __syncwarp();
    SplatSums<T, CHANNELS> sums{};
    const int member = lane % GROUP;
    const bool has_splat = member < members;
    const uint8* numbers = reinterpret_cast<const uint8*>(memory.list);
    const int entry = numbers[group * GROUP + (has_splat ? member : 0)];
    if (has_splat) {
      sum_pixels<T, CHANNELS, ABSOLUTE>(memory, subtile, entries.splats[entry], sums);
    }
    add_halves<T, CHANNELS, ABSOLUTE>(sums, has_splat && lane < GROUP, memory.sums[entry]);
    __syncwarp();
  }
}

/// Hand a chunk's sums on: to the pairs' own rows, or to those of the splats.
template <class T, int CHANNELS, int CHUNK, int WARPS, bool ABSOLUTE>
__device__ __forceinline__ void write_sums(
    const BlendBackwardJob& job, const ChunkPlace& place,
    const WarpMemory<T, CHANNELS, CHUNK, ABSOLUTE> (&warps)[WARPS]) {
  const BlendJob& forward = job.forward;
  constexpr int FIELDS = WarpMemory<T, CHANNELS, CHUNK, ABSOLUTE>::FIELDS;
  // Neighbouring threads take neighbouring numbers of one splat, which share a line of memory.
  for (int item = int(threadIdx.x); item < place.count * FIELDS; item += WARPS * WARP) {
    const int entry = item / FIELDS, k = item % FIELDS;
    // Padding up to CHANNELS is left out, lest it take the place of the magnitudes.
    const bool magnitude = k >= SUM_CHANNELS + CHANNELS;
    if (k >= SUM_CHANNELS + forward.channels && !magnitude) continue;
    const int64 pair = place.first + entry;
    const int64 row = forward.slots ? forward.slots[pair] : forward.rows[pair];
    T* to = static_cast<T*>(job.sums) + row * job.sum_stride +
            (magnitude ? k - CHANNELS + forward.channels : k);
    T value = warps[0].sums[entry][k];
#pragma unroll
    for (int warp = 1; warp < WARPS; ++warp) value += warps[warp].sums[entry][k];
    if (forward.slots) {
      *to = value;
    } else if (value != T(0)) {
      atomicAdd(to, value);
    }
  }
}

/// Fetch a chunk's splats, and set all sums to 0.
template <class T, int CHANNELS, int CHUNK, int THREADS, bool ABSOLUTE>
__device__ __forceinline__ void begin_chunk(
    const BlendJob& job, const ChunkPlace& place,
    ChunkMemory<T, CHANNELS, CHUNK, THREADS, ABSOLUTE>& memory) {
  for (int entry = int(threadIdx.x); entry < place.count; entry += THREADS) {
    load_entry(job, place.tile, place.first, entry, memory.entries);
    for (auto& warp : memory.warps) {
#pragma unroll
      for (T& sum : warp.sums[entry]) sum = T(0);
    }
  }
  T* none = memory.entries.splats[CHUNK];
  for (int k = int(threadIdx.x); k < memory.entries.STRIDE; k += THREADS) {
    none[k] = k == BLEND_LEVEL ? T(UNSEEN) : T(0);
  }
}

/// Blocks that are to fit on a multiprocessor at once. Few channels need no more than 128 registers,
/// with which a multiprocessor has room for 16 warps; told nothing, the compiler takes more.
template <class T, int CHANNELS, int THREADS>
constexpr int RESIDENT_CHUNKS = sizeof(T) > 4 || CHANNELS > 4 ? 1 : 16 * WARP / THREADS;

/// One block of ``THREADS`` per chunk: ``tiles + chunks`` of them.
template <class T, int CHANNELS, int CHUNK, int THREADS, bool ABSOLUTE>
__global__ void __launch_bounds__(THREADS, (RESIDENT_CHUNKS<T, CHANNELS, THREADS>))
    blend_backward(BlendBackwardJob job) {
  __shared__ ChunkMemory<T, CHANNELS, CHUNK, THREADS, ABSOLUTE> memory;
  const ChunkPlace found = place_of<CHUNK>(job.forward, blockIdx.x);
  if (found.count == 0) return;
  if (threadIdx.x == 0) memory.place = found;
  begin_chunk(job.forward, found, memory);
  __syncthreads();
  const ChunkPlace& place = memory.place;
  // 0 where the compiler can know it: what follows is then the same for all threads to it.
  const int warp = THREADS > WARP ? warp_index() : 0;
  for (int subtile = warp; subtile < SUBTILES; subtile += THREADS / WARP) {
    backward_subtile<T, CHANNELS, CHUNK, ABSOLUTE>(job, place, subtile, memory.entries,
                                                   memory.warps[warp]);
  }
  __syncthreads();
  write_sums(job, place, memory.warps);
}

}  // namespace cuda
}  // namespace gsfw
