// Blend: alpha-composite the splats of one tile, from front to back.
//
// Kerbl et al. 2023, equation 3. A tile is blended block by block: the sixteen pixels of a block
// are the lanes of a pack, whose transmittance and colour stay in registers while the block's own
// list of splats runs past. Backward sees alpha through the same function, so both agree bit for
// bit.
#pragma once

#include "simd/simd.h"
#include "stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Room for the indices of one block's splats; appending writes up to 16 more.
constexpr int LIST = CHUNK + 2 * LANES;
/// Splats of a block that are evaluated together.
constexpr int UNROLL = 4;

/// Pixel centres of each block, measured from the middle of the tile.
template <typename T>
struct PixelTable {
  T x[BLOCKS][LANES];
  T y[BLOCKS][LANES];

  constexpr PixelTable() : x(), y() {
    for (int b = 0; b < BLOCKS; ++b) {
      for (int lane = 0; lane < LANES; ++lane) {
        x[b][lane] = T((b % TILE_BLOCKS) * BLOCK + lane % BLOCK) + T(0.5) - T(TILE / 2);
        y[b][lane] = T((b / TILE_BLOCKS) * BLOCK + lane / BLOCK) + T(0.5) - T(TILE / 2);
      }
    }
  }
};

template <typename T>
struct PixelTables {
  alignas(64) static constexpr PixelTable<T> pixels{};
};

/// A chunk of a tile's entries, copied next to one another, with centres folded into u and v:
/// field SPLAT_X holds u and SPLAT_Y holds v at the middle of the tile.
template <typename T>
struct Chunk {
  /// [CHUNK + 1, stride]; the last one in use blends nothing.
  T* projected;
  /// [CHUNK + 16]
  uint32_t* blocks;
  /// [BLOCKS, LIST]
  uint16_t* lists;
  int count;
  int lengths[BLOCKS];
};

/// Place of a tile, and its part of the image.
struct TilePlace {
  int x, y, width, height;
};

GSFW_FUNCTION TilePlace place_of(const Grid& grid, int tile) {
  const int x = tile % grid.columns * TILE, y = tile / grid.columns * TILE;
  const int width = grid.width - x, height = grid.height - y;
  return {x, y, width < TILE ? width : TILE, height < TILE ? height : TILE};
}

/// Position of a pixel of the tile when it is stored block after block.
GSFW_FUNCTION int block_position(int x, int y) {
  return (y / BLOCK * TILE_BLOCKS + x / BLOCK) * LANES + y % BLOCK * BLOCK + x % BLOCK;
}

/// Copy ``count`` entries; those from ``next`` on are likely to be wanted after them.
template <typename T>
GSFW_FUNCTION void load_chunk(const BlendJob<T>& job, const TilePlace& place, const Entry* entries,
                              int count, const Entry* next, Chunk<T>& chunk) {
  const int stride = job.stride;
  const T middle_x = T(place.x + TILE / 2), middle_y = T(place.y + TILE / 2);
  constexpr int AHEAD = 24;
  const Entry* all_end = job.entries + job.tile_starts[job.grid.columns * job.grid.rows];
  for (int i = 0; i < count; ++i) {
    const Entry* ahead = i + AHEAD < count ? entries + i + AHEAD : next + (i + AHEAD - count);
    if (ahead < all_end) __builtin_prefetch(job.projected + int64_t(ahead->row) * stride);
    const T* from = job.projected + int64_t(entries[i].row) * stride;
    T* to = chunk.projected + i * stride;
    for (int k = 0; k < stride; k += LANES) store(to + k, load(from + k));
    const T x = from[SPLAT_X] - middle_x, y = from[SPLAT_Y] - middle_y;
    to[SPLAT_X] = -from[SPLAT_R] * x;
    to[SPLAT_Y] = -(from[SPLAT_W] * y + from[SPLAT_WK] * x);
    chunk.blocks[i] = entries[i].blocks;
  }
  T* nothing = chunk.projected + count * stride;
  for (int k = 0; k < stride; ++k) nothing[k] = T(0);
  nothing[SPLAT_LEVEL] = T(-1000);
  chunk.count = count;
  split_by_bit(chunk.blocks, count, chunk.lists, LIST, chunk.lengths);
  for (int b = 0; b < BLOCKS; ++b) {
    for (int j = 0; j < UNROLL; ++j) chunk.lists[b * LIST + chunk.lengths[b] + j] = uint16_t(count);
  }
}

/// Whitened coordinates of pixels, a pack of them or a part: 2 fma each, no cancellation beyond the
/// tile's size.
template <typename N>
struct Whitened {
  N u, v;
};

template <typename N, typename T>
GSFW_FUNCTION Whitened<N> whitened(const T* splat, const N& x, const N& y) {
  return {fma(N(splat[SPLAT_R]), x, N(splat[SPLAT_X])),
          fma(N(splat[SPLAT_W]), y, fma(N(splat[SPLAT_WK]), x, N(splat[SPLAT_Y])))};
}

/// Alpha of one splat at a block's pixels, 0 where it is skipped.
template <typename T>
GSFW_FUNCTION Pack<T> alpha_of(const T* splat, const Pack<T>& x, const Pack<T>& y,
                               const CutOffs<T>& cut) {
  const Whitened<Pack<T>> at = whitened(splat, x, y);
  const Pack<T> level =
      fma_negated(at.v, at.v, fma_negated(at.u, at.u, Pack<T>(splat[SPLAT_LEVEL])));
  const LaneMask<T> rendered = level >= Pack<T>(cut.level_min);
  return keep(rendered, minimum(power_of_two(level), Pack<T>(cut.alpha_cap)));
}

/// The state of a tile while it is blended, each plane block after block.
template <typename T>
struct TileState {
  /// [PIXELS]: transmittance, as if blending never stopped; 0 outside the image.
  T* transmittance;
  /// [PIXELS]: transmittance behind the last splat that was rendered.
  T* left;
  /// [PIXELS]: what each pixel counts in the contributions; unset unless these are measured.
  T* pixel_weights;
  /// [BLOCKS, channels, LANES]
  T* blended;
};

/// Fetch what the pixels of a tile count in the contributions, 0 outside the image.
template <typename T>
GSFW_FUNCTION void load_pixel_weights(const BlendJob<T>& job, const TilePlace& place, T* to) {
  for (int i = 0; i < PIXELS; ++i) to[i] = T(0);
  for (int y = 0; y < place.height; ++y) {
    const int64_t row = int64_t(place.y + y) * job.grid.width + place.x;
    for (int x = 0; x < place.width; ++x) {
      to[block_position(x, y)] = job.pixel_weights ? job.pixel_weights[row + x] : T(1);
    }
  }
}

template <typename T>
GSFW_FUNCTION void start_tile(const TilePlace& place, const TileState<T>& state, int channels) {
  const bool whole = place.width == TILE && place.height == TILE;
  for (int i = 0; i < PIXELS; ++i) state.transmittance[i] = T(whole);
  for (int y = 0; y < place.height && !whole; ++y) {
    for (int x = 0; x < place.width; ++x) state.transmittance[block_position(x, y)] = T(1);
  }
  for (int i = 0; i < PIXELS; ++i) state.left[i] = T(1);
  for (int i = 0; i < PIXELS * channels; ++i) state.blended[i] = T(0);
}

/// Ask for the memory of row ``y`` of the tile's pixels while the tile is blended: otherwise the
/// processor waits for it when they are written.
template <typename T>
GSFW_FUNCTION void ask_for_pixels(const BlendJob<T>& job, const TilePlace& place, int y) {
  if (y >= place.height) return;
  constexpr int LINE = 64 / sizeof(T);
  const int64_t first = int64_t(place.y + y) * job.grid.width + place.x;
  const int64_t last = first + place.width - 1, channels = job.channels;
  for (int64_t k = first * channels; k < last * channels; k += LINE) {
    __builtin_prefetch(job.image + k, 1);
  }
  __builtin_prefetch(job.image + last * channels, 1);
  __builtin_prefetch(job.alpha + first, 1);
  __builtin_prefetch(job.alpha + last, 1);
}

/// Blend one block with one chunk.
///
/// ``CHANNELS`` is 0 where their number is known at run time only. ``sums`` gathers each splat's
/// weights, times those of the pixels, lane by lane, when ``MEASURE``. Returns whether any pixel
/// still sees through.
template <typename T, int CHANNELS, bool MEASURE>
GSFW_FUNCTION bool blend_block(const BlendJob<T>& job, const Chunk<T>& chunk, int b,
                               const TileState<T>& state, T* sums) {
  const int channels = CHANNELS ? CHANNELS : job.channels;
  const CutOffs<T> cut = job.cut_offs;
  const Pack<T> x = load(PixelTables<T>::pixels.x[b]), y = load(PixelTables<T>::pixels.y[b]);
  const Pack<T> stop(cut.transmittance_min), one(T(1));
  const Pack<T> pixel_weight = MEASURE ? load(state.pixel_weights + b * LANES) : one;
  Pack<T> transmittance = load(state.transmittance + b * LANES);
  if (!any(transmittance > stop)) return false;
  Pack<T> left = load(state.left + b * LANES);
  T* blended = state.blended + b * channels * LANES;
  Pack<T> color[CHANNELS ? CHANNELS : 1];
  for (int c = 0; c < CHANNELS; ++c) color[c] = load(blended + c * LANES);
  const uint16_t* list = chunk.lists + b * LIST;
  const int length = chunk.lengths[b];
  bool open = true;
  for (int k = 0; k < length && open; k += UNROLL) {
    Pack<T> alpha[UNROLL];
    const T* splat[UNROLL];
    for (int j = 0; j < UNROLL; ++j) {
      splat[j] = chunk.projected + list[k + j] * job.stride;
      alpha[j] = alpha_of(splat[j], x, y, cut);
    }
    for (int j = 0; j < UNROLL; ++j) {
      Pack<T> weight = alpha[j] * transmittance;
      transmittance = transmittance * (one - alpha[j]);
      const LaneMask<T> rendered = transmittance > stop;
      weight = keep(rendered, weight);
      left = select(rendered, transmittance, left);
      for (int c = 0; c < CHANNELS; ++c) {
        color[c] = fma(weight, Pack<T>(splat[j][SPLAT_CHANNELS + c]), color[c]);
      }
      for (int c = 0; CHANNELS == 0 && c < channels; ++c) {
        T* plane = blended + c * LANES;
        store(plane, fma(weight, Pack<T>(splat[j][SPLAT_CHANNELS + c]), load(plane)));
      }
      if (MEASURE) {
        T* at = sums + list[k + j] * LANES;
        store(at, fma(weight, pixel_weight, load(at)));
      }
    }
    open = any(transmittance > stop);
  }
  store(state.transmittance + b * LANES, transmittance);
  store(state.left + b * LANES, left);
  for (int c = 0; c < CHANNELS; ++c) store(blended + c * LANES, color[c]);
  return open;
}

/// Add the background and write one block of a whole tile to the image: four rows of four pixels.
template <typename T>
GSFW_FUNCTION void finish_rgb_block(const BlendJob<T>& job, const TilePlace& place, int b,
                                    const TileState<T>& state) {
  const Pack<T> left = load(state.left + b * LANES);
  const T* blended = state.blended + b * 3 * LANES;
  Pack<T> color[3];
  for (int c = 0; c < 3; ++c) {
    color[c] = load(blended + c * LANES) + left * Pack<T>(job.background[c]);
  }
  T pixels[3 * LANES], alpha[LANES];
  store_rows<3>(pixels, LANES, color);
  store(alpha, Pack<T>(T(1)) - left);
  int64_t at = int64_t(place.y + b / TILE_BLOCKS * BLOCK) * job.grid.width + place.x +
               b % TILE_BLOCKS * BLOCK;
  for (int y = 0; y < BLOCK; ++y, at += job.grid.width) {
    memcpy(job.image + at * 3, pixels + y * BLOCK * 3, BLOCK * 3 * sizeof(T));
    memcpy(job.alpha + at, alpha + y * BLOCK, BLOCK * sizeof(T));
  }
}

template <typename T>
GSFW_FUNCTION void finish_tile(const BlendJob<T>& job, const TilePlace& place,
                               const TileState<T>& state) {
  const int channels = job.channels;
  if (channels == 3 && place.width == TILE && place.height == TILE) {
    for (int b = 0; b < BLOCKS; ++b) finish_rgb_block(job, place, b, state);
    return;
  }
  for (int y = 0; y < place.height; ++y) {
    const int64_t row = int64_t(place.y + y) * job.grid.width + place.x;
    for (int x = 0; x < place.width; ++x) {
      const int at = block_position(x, y);
      const T left = state.left[at];
      job.alpha[row + x] = T(1) - left;
      const T* blended = state.blended + at / LANES * channels * LANES + at % LANES;
      T* to = job.image + (row + x) * channels;
      for (int c = 0; c < channels; ++c) to[c] = blended[c * LANES] + left * job.background[c];
    }
  }
}

/// Working memory of one thread, in numbers of T.
template <typename T>
GSFW_FUNCTION int64_t blend_scratch(int stride, int channels) {
  const int64_t lists = (BLOCKS * LIST * sizeof(uint16_t) + (CHUNK + LANES) * sizeof(uint32_t));
  return (CHUNK + 1) * int64_t(stride) + lists / sizeof(T) + LANES + PIXELS * (3 + channels) +
         (CHUNK + 1) * LANES;
}

template <typename T>
GSFW_FUNCTION T* take_chunk(T* scratch, int stride, Chunk<T>& chunk) {
  chunk.projected = scratch;
  scratch += (CHUNK + 1) * stride;
  chunk.blocks = reinterpret_cast<uint32_t*>(scratch);
  chunk.lists = reinterpret_cast<uint16_t*>(chunk.blocks + CHUNK + LANES);
  const int64_t bytes = (CHUNK + LANES) * sizeof(uint32_t) + BLOCKS * LIST * sizeof(uint16_t);
  return scratch + (bytes + sizeof(T) * LANES - 1) / (sizeof(T) * LANES) * LANES;
}

template <typename T, int CHANNELS, bool MEASURE>
void blend_tile(const BlendJob<T>& job, int tile, T* scratch) {
  const TilePlace place = place_of(job.grid, tile);
  Chunk<T> chunk;
  scratch = take_chunk(scratch, job.stride, chunk);
  TileState<T> state = {scratch, scratch + PIXELS, scratch + 2 * PIXELS, scratch + 3 * PIXELS};
  T* sums = state.blended + PIXELS * job.channels;
  start_tile(place, state, job.channels);
  if (MEASURE) load_pixel_weights(job, place, state.pixel_weights);
  const int64_t end = job.tile_starts[tile + 1];
  int32_t rendered = 0;
  bool open = true;
  for (int64_t first = job.tile_starts[tile]; first < end; first += CHUNK) {
    const int count = int(end - first < CHUNK ? end - first : CHUNK);
    if (MEASURE && !open) {
      for (int i = 0; i < count; ++i) job.contribution[job.entries[first + i].slot] = T(0);
    }
    if (!open) continue;
    T* checkpoint = job.checkpoints + (job.chunk_starts[tile] + rendered) * PIXELS;
    memcpy(checkpoint, state.transmittance, PIXELS * sizeof(T));
    const Entry* entries = job.entries + first;
    load_chunk(job, place, entries, count, entries + count, chunk);
    for (int i = 0; MEASURE && i < count * LANES; ++i) sums[i] = T(0);
    open = false;
    static_assert(BLOCKS == TILE, "a row of pixels is asked for with each block");
    for (int b = 0; b < BLOCKS; ++b) {
      if (rendered == 0) ask_for_pixels(job, place, b);
      open |= blend_block<T, CHANNELS, MEASURE>(job, chunk, b, state, sums);
    }
    for (int i = 0; MEASURE && i < count; ++i) {
      job.contribution[job.entries[first + i].slot] = sum(load(sums + i * LANES));
    }
    ++rendered;
  }
  job.chunks_blended[tile] = rendered;
  finish_tile(job, place, state);
}

/// Blend tile number ``tile``; ``scratch`` is as long as ``blend_scratch`` says.
template <typename T>
void blend(const BlendJob<T>& job, int tile, T* scratch) {
  const bool measure = job.contribution != nullptr;
  if (job.channels == 3 && !measure) return blend_tile<T, 3, false>(job, tile, scratch);
  if (job.channels == 3) return blend_tile<T, 3, true>(job, tile, scratch);
  if (!measure) return blend_tile<T, 0, false>(job, tile, scratch);
  blend_tile<T, 0, true>(job, tile, scratch);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
