// Tile: the pixels of one, and the splats that are blended on them.
//
// Forward and backward see alpha through the same function of explicitly fused operations, so that
// both agree bit for bit on what is rendered.
#pragma once

#include "stages.h"

#include "falloff.h"
#include "reach.h"

namespace gsfw {
namespace cuda {

/// One pixel of a subtile, as one thread has it.
template <class T>
struct Pixel {
  /// Centre, measured from the middle of the tile: small numbers, whose differences keep digits.
  T x, y;
  /// Position in the image, row after row; 0 outside.
  int64 index;
  bool inside;
};

/// Centre of pixel number ``lane`` of a subtile, measured from the middle of the tile.
template <class T>
__device__ __forceinline__ T pixel_x(int subtile, int lane) {
  return T(subtile % 2 * SUBTILE_WIDTH + lane % SUBTILE_WIDTH - TILE / 2) + T(0.5);
}
template <class T>
__device__ __forceinline__ T pixel_y(int subtile, int lane) {
  return T(subtile / 2 * SUBTILE_HEIGHT + lane / SUBTILE_WIDTH - TILE / 2) + T(0.5);
}

template <class T>
__device__ __forceinline__ Pixel<T> pixel_of(const Grid& grid, int tile, int subtile, int lane) {
  const int left = tile % grid.columns * TILE, top = tile / grid.columns * TILE;
  const int x = left + subtile % 2 * SUBTILE_WIDTH + lane % SUBTILE_WIDTH;
  const int y = top + subtile / 2 * SUBTILE_HEIGHT + lane / SUBTILE_WIDTH;
  const bool inside = x < grid.width && y < grid.height;
  return {pixel_x<T>(subtile, lane), pixel_y<T>(subtile, lane),
          inside ? int64(y) * grid.width + x : 0, inside};
}

/// Fields of a splat for blending, in order: u and v at the middle of the tile; r, -w k
/// and w of the whitening; level. The channels follow.
enum BlendField { BLEND_U, BLEND_V, BLEND_R, BLEND_WK, BLEND_W, BLEND_LEVEL, BLEND_FIELDS };

/// The least multiple of four that is no less than ``n``: one load of 16 bytes fetches four floats.
__device__ constexpr int whole_fours(int n) { return (n + 3) / 4 * 4; }

/// A chunk of a tile's splats in shared memory.
template <class T, int CHANNELS, int CHUNK>
struct Entries {
  static constexpr int STRIDE = whole_fours(BLEND_FIELDS + CHANNELS);
  /// The first channel, with as many others in its four as have room there.
  static constexpr int COLOR = STRIDE - whole_fours(CHANNELS) < BLEND_FIELDS
                                   ? int(BLEND_FIELDS)
                                   : STRIDE - whole_fours(CHANNELS);

  __align__(16) T splats[CHUNK][STRIDE];
  /// Bit s: the splat may reach subtile s.
  uint8 subtiles[CHUNK];
};

/// Fetch entry ``place`` of a chunk whose first pair is number ``first``.
template <class T, int CHANNELS, int CHUNK>
__device__ __forceinline__ void load_entry(const BlendJob& job, int tile, int64 first, int place,
                                           Entries<T, CHANNELS, CHUNK>& entries) {
  // All of the projected splat that is used, four numbers at a time, into registers.
  constexpr int FOURS = (SPLAT_CHANNELS + CHANNELS + 3) / 4;
  __align__(16) T splat[4 * FOURS];
  const int64 row = job.rows[first + place];
  const Four<T>* from = reinterpret_cast<const Four<T>*>(static_cast<const T*>(job.projected) +
                                                         row * job.stride);
#pragma unroll
  for (int i = 0; i < FOURS; ++i) {
    const Four<T> four = from[i];
    for (int k = 0; k < 4; ++k) splat[4 * i + k] = four.numbers[k];
  }
  const int left = tile % job.grid.columns * TILE, top = tile / job.grid.columns * TILE;
  entries.subtiles[place] = uint8(subtiles_reached(splat, left, top, job.bounded != 0));
  T* to = entries.splats[place];
  const T x = splat[SPLAT_X] - T(left + TILE / 2), y = splat[SPLAT_Y] - T(top + TILE / 2);
  to[BLEND_U] = -(splat[SPLAT_R] * x);
  to[BLEND_V] = -fma(splat[SPLAT_W], y, splat[SPLAT_WK] * x);
  to[BLEND_R] = splat[SPLAT_R];
  to[BLEND_WK] = splat[SPLAT_WK];
  to[BLEND_W] = splat[SPLAT_W];
  to[BLEND_LEVEL] = splat[SPLAT_LEVEL];
#pragma unroll
  for (int c = 0; c < CHANNELS; ++c) to[entries.COLOR + c] = splat[SPLAT_CHANNELS + c];
}

/// A job's number as a T, converted at this place: the compiler would rather convert it anew in
/// every turn of a loop, slowly, than keep a register for it.
template <class T>
__device__ __forceinline__ T pinned(double number) {
  T converted = T(number);
#ifdef __CUDA_ARCH__
  if constexpr (sizeof(T) == sizeof(float)) asm volatile("" : "+f"(converted));
#endif
  return converted;
}

/// u and v of a splat, scaled for binary, at a pixel.
template <class T>
__device__ __forceinline__ Vector2<T> whitened_at(const T* splat, T x, T y) {
  return {fma(splat[BLEND_R], x, splat[BLEND_U]),
          fma(splat[BLEND_W], y, fma(splat[BLEND_WK], x, splat[BLEND_V]))};
}

/// Alpha of a splat at a pixel, 0 where it is skipped.
template <class T>
__device__ __forceinline__ T alpha_at(const T* splat, T x, T y, T level_min, T alpha_cap) {
  const T level = alpha_exponent(splat[BLEND_LEVEL], whitened_at(splat, x, y));
  return level >= level_min ? least(power_of_two(level), alpha_cap) : T(0);
}

/// Address of one pixel's checkpoint in front of a chunk: [1 + CHANNELS] numbers, 256
/// apart.
template <class T, int CHANNELS>
__device__ __forceinline__ T* checkpoint_of(const BlendJob& job, int64 row, int pixel) {
  return static_cast<T*>(job.checkpoints) + row * ((1 + CHANNELS) * TILE_PIXELS) + pixel;
}

}  // namespace cuda
}  // namespace gsfw
