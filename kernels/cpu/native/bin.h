// Bin: which splat intersects which tile and which of its blocks, exactly.
//
// An ellipse cut by a strip of pixel rows spans an interval of x, because the cut is convex; a
// block of the strip is reached if and only if its pixel centres overlap that interval. Sixteen
// strips, four pixels high each, are processed at once.
#pragma once

#include "simd/simd.h"
#include "stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Pixels, and 1/100 of it per pixel of extent, by which rounding may not shrink an ellipse.
constexpr double SLACK = 1e-3;

/// First and last block of sixteen strips.
struct Strips {
  alignas(64) int32_t first[LANES];
  alignas(64) int32_t last[LANES];
};

template <typename T>
GSFW_FUNCTION void to_integers(const Pack<T>& a, int32_t* to) {
  alignas(64) T lanes[LANES];
  store(lanes, a);
  for (int i = 0; i < LANES; ++i) to[i] = int32_t(lanes[i]);
}

/// First block whose last pixel centre is not before ``low``, in blocks; may be fractional.
template <typename N, typename T>
GSFW_FUNCTION N first_block(const N& low) {
  return -round_down((N(T(BLOCK - 0.5)) - low) * N(T(1.0 / BLOCK)));
}

template <typename N, typename T>
GSFW_FUNCTION N last_block(const N& high) {
  return round_down((high - N(T(0.5))) * N(T(1.0 / BLOCK)));
}

/// Starts of sixteen strips, in pixels from the first one.
template <typename T>
struct StripTable {
  T offset[LANES];

  constexpr StripTable() : offset() {
    for (int i = 0; i < LANES; ++i) offset[i] = T(i * BLOCK);
  }
};

/// The blocks that an ellipse intersects in the sixteen strips from ``strip`` on.
template <typename T>
GSFW_FUNCTION void intersect_strips(const T* splat, int strip, int blocks, Strips& strips) {
  static constexpr StripTable<T> table{};
  const Pack<T> height(splat[SPLAT_HEIGHT]), turn(splat[SPLAT_TURN]), tilt(splat[SPLAT_TILT]);
  const Pack<T> top = load(table.offset) + Pack<T>(T(strip * BLOCK) + T(0.5) - splat[SPLAT_Y]);
  const Pack<T> narrow(splat[SPLAT_NARROW]), one(T(1));
  // Within a strip the ellipse is widest where it turns, or else at the nearer edge of the strip.
  const Pack<T> low = minimum(maximum(top, -height), height);
  const Pack<T> high = minimum(maximum(top + Pack<T>(T(BLOCK - 1)), -height), height);
  const Pack<T> at_right = minimum(maximum(turn, low), high);
  const Pack<T> at_left = minimum(maximum(-turn, low), high);
  const Pack<T> shrink(T(1) / splat[SPLAT_HEIGHT]), zero(T(0));
  const Pack<T> up = at_right * shrink, down = at_left * shrink;
  const Pack<T> half_right = square_root(maximum(fma_negated(up, up, one), zero));
  const Pack<T> half_left = square_root(maximum(fma_negated(down, down, one), zero));
  const Pack<T> right = fma(tilt, at_right, narrow * half_right);
  const Pack<T> left = fma_negated(narrow, half_left, tilt * at_left);
  const Pack<T> slack(T(SLACK) + T(0.01 * SLACK) * splat[SPLAT_WIDTH]), x(splat[SPLAT_X]);
  const Pack<T> most{T(blocks)}, none(T(-1));
  const Pack<T> first = first_block<Pack<T>, T>(x + left - slack);
  const Pack<T> last = last_block<Pack<T>, T>(x + right + slack);
  to_integers(minimum(maximum(first, zero), most), strips.first);
  to_integers(minimum(maximum(last, none), most - one), strips.last);
}

/// Bits ``first`` to ``last``, as far as they lie between 0 and 63.
GSFW_FUNCTION uint64_t bit_range(int first, int last) {
  const int low = first < 0 ? 0 : first, high = last > 63 ? 63 : last;
  return low > high ? 0 : (~uint64_t(0) << low) & (~uint64_t(0) >> (63 - high));
}

/// Append the intersections of one row of tiles with strips ``begin`` to ``end`` of its four.
GSFW_FUNCTION int64_t intersect_tiles(uint32_t row, int tile, const Strips& strips, int begin,
                                      int end, Intersection* to) {
  int low = strips.first[begin], high = strips.last[begin];
  for (int s = begin + 1; s < end; ++s) {
    low = strips.first[s] < low ? strips.first[s] : low;
    high = strips.last[s] > high ? strips.last[s] : high;
  }
  int64_t count = 0;
  const int shift = begin % TILE_BLOCKS * TILE_BLOCKS;
  for (int column = low / TILE_BLOCKS; column * TILE_BLOCKS <= high; column += 16) {
    uint64_t wide[TILE_BLOCKS] = {0, 0, 0, 0};
    for (int s = begin; s < end; ++s) {
      const int base = column * TILE_BLOCKS;
      wide[s - begin] = bit_range(strips.first[s] - base, strips.last[s] - base);
    }
    for (int k = 0; k < 16 && (column + k) * TILE_BLOCKS <= high; ++k) {
      uint32_t bits = 0;
      for (int s = 0; s < TILE_BLOCKS; ++s) {
        bits |= uint32_t(wide[s] & 15) << (s * TILE_BLOCKS);
        wide[s] >>= TILE_BLOCKS;
      }
      to[count] = {row, uint32_t(tile + column + k), bits << shift};
      count += bits != 0;
    }
  }
  return count;
}

template <typename T>
GSFW_FUNCTION int64_t intersect_all(const BinJob<T>& job, uint32_t row, Intersection* to) {
  const int tiles = job.grid.columns * job.grid.rows;
  for (int tile = 0; tile < tiles; ++tile) to[tile] = {row, uint32_t(tile), (1u << BLOCKS) - 1u};
  return tiles;
}

/// Append all intersections of the splat in row ``row`` to ``to``, which has room for one per tile
/// and one more.
template <typename T>
int64_t intersect(const BinJob<T>& job, uint32_t row, Intersection* to) {
  if (!job.bounded) return intersect_all(job, row, to);
  const T* splat = job.projected + int64_t(row) * job.stride;
  const int across = (job.grid.width + BLOCK - 1) / BLOCK;
  const int strips = (job.grid.height + BLOCK - 1) / BLOCK;
  const T slack = T(SLACK) + T(0.01 * SLACK) * splat[SPLAT_HEIGHT];
  const T top = first_block<T, T>(splat[SPLAT_Y] - splat[SPLAT_HEIGHT] - slack);
  const T bottom = last_block<T, T>(splat[SPLAT_Y] + splat[SPLAT_HEIGHT] + slack);
  // Clamped before they become integers, which hold no infinity.
  const int first = int(top > T(0) ? (top < T(strips) ? top : T(strips)) : T(0));
  const int last = int(bottom < T(strips - 1) ? (bottom > T(-1) ? bottom : T(-1)) : T(strips - 1));
  int64_t count = 0;
  for (int base = first / TILE_BLOCKS * TILE_BLOCKS; base <= last; base += LANES) {
    Strips found;
    intersect_strips(splat, base, across, found);
    for (int s = 0; s < LANES && base + s <= last; s += TILE_BLOCKS) {
      const int begin = first > base + s ? first - base : s;
      const int end = last + 1 < base + s + TILE_BLOCKS ? last + 1 - base : s + TILE_BLOCKS;
      const int tile = (base + s) / TILE_BLOCKS * job.grid.columns;
      count += intersect_tiles(row, tile, found, begin, end, to + count);
    }
  }
  return count;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
