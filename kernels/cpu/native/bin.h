// Bin: which splat intersects which tile and which of its blocks, exactly.
//
// An ellipse cut by a strip of pixel rows spans an interval of x, because the cut is convex; a
// block of the strip is reached if and only if its pixel centres overlap that interval. Sixteen
// strips, four pixels high each, are processed at once, and sixteen blocks of each of them: a
// window of four by four tiles, which holds most splats; nothing branches on a splat's shape within
// a window.
#pragma once

#include "simd/simd.h"
#include "stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Tiles along the side of a window.
constexpr int WINDOW_TILES = LANES / TILE_BLOCKS;

/// First block whose last pixel centre is not before ``low``, in blocks; may be fractional.
template <typename N, typename T>
GSFW_FUNCTION N first_block(const N& low) {
  return -round_down((N(T(BLOCK - 0.5)) - low) * N(T(1.0 / BLOCK)));
}

template <typename N, typename T>
GSFW_FUNCTION N last_block(const N& high) {
  return round_down((high - N(T(0.5))) * N(T(1.0 / BLOCK)));
}

/// First and last block along one axis; none where the last is before the first.
struct BlockRange {
  int first, last;
};

/// The blocks along one axis that a splat's bounding box reaches, of ``blocks``.
template <typename T>
GSFW_FUNCTION BlockRange reached(T centre, T half, int blocks) {
  const T slack = T(SLACK) + T(0.01 * SLACK) * half;
  const T low = first_block<T, T>(centre - half - slack);
  const T high = last_block<T, T>(centre + half + slack);
  // Clamped before they become integers, which hold no infinity.
  return {int(low > T(0) ? (low < T(blocks) ? low : T(blocks)) : T(0)),
          int(high < T(blocks - 1) ? (high > T(-1) ? high : T(-1)) : T(blocks - 1))};
}

/// The lanes' numbers.
template <typename T>
struct LaneTable {
  T number[LANES];

  constexpr LaneTable() : number() {
    for (int i = 0; i < LANES; ++i) number[i] = T(i);
  }
};

/// The blocks that an ellipse reaches in sixteen strips, in blocks from the image's edge: the
/// first, and the one behind the last.
template <typename T>
struct Strips {
  Pack<T> first, end;
};

/// Those in the sixteen strips from ``strip`` on, none of them beyond ``rows`` or the ``across``
/// blocks of the image.
template <typename T>
GSFW_FUNCTION Strips<T> intersect_strips(const T* splat, int strip, const BlockRange& rows,
                                         int across) {
  using N = Pack<T>;
  static constexpr LaneTable<T> lanes{};
  const N height(splat[SPLAT_HEIGHT]), turn(splat[SPLAT_TURN]), tilt(splat[SPLAT_TILT]);
  const N lane = load(lanes.number), narrow(splat[SPLAT_NARROW]), one(T(1)), zero(T(0));
  const N top = fma(lane, N(T(BLOCK)), N(T(strip * BLOCK) + T(0.5) - splat[SPLAT_Y]));
  // Within a strip the ellipse is widest where it turns, or else at the nearer edge of the strip.
  const N low = minimum(maximum(top, -height), height);
  const N high = minimum(maximum(top + N(T(BLOCK - 1)), -height), height);
  const N at_right = minimum(maximum(turn, low), high);
  const N at_left = minimum(maximum(-turn, low), high);
  const N shrink(T(1) / splat[SPLAT_HEIGHT]);
  const N up = at_right * shrink, down = at_left * shrink;
  const N half_right = square_root(maximum(fma_negated(up, up, one), zero));
  const N half_left = square_root(maximum(fma_negated(down, down, one), zero));
  const N right = fma(tilt, at_right, narrow * half_right);
  const N left = fma_negated(narrow, half_left, tilt * at_left);
  const N slack(T(SLACK) + T(0.01 * SLACK) * splat[SPLAT_WIDTH]), x(splat[SPLAT_X]);
  const N first = first_block<N, T>(x + left - slack);
  const N last = last_block<N, T>(x + right + slack);
  const LaneMask<T> reaches =
      (lane >= N(T(rows.first - strip))) & (lane <= N(T(rows.last - strip)));
  return {maximum(first, zero), keep(reaches, minimum(last + one, N(T(across))))};
}

/// The four by four groups of four bits in a word, rows as columns.
GSFW_FUNCTION uint64_t transpose_groups(uint64_t word) {
  const uint64_t near = (word ^ (word >> 12)) & 0x0000f0f00000f0f0u;
  word ^= near ^ (near << 12);
  const uint64_t far = (word ^ (word >> 24)) & 0x00000000ff00ff00u;
  return word ^ far ^ (far << 24);
}

/// The blocks of a window whose first block across is ``block``: a word for each row of tiles, with
/// sixteen bits for each tile.
template <typename T>
GSFW_FUNCTION void find_window(const Strips<T>& strips, int block, uint64_t* words) {
  using N = Pack<T>;
  const N base{T(block)};
  const N end = minimum(maximum(strips.end - base, N(T(0))), N(T(LANES)));
  const N first = minimum(maximum(strips.first - base, N(T(0))), end);
  alignas(64) uint16_t rows[LANES];
  bit_ranges(first, end, rows);
  memcpy(words, rows, sizeof(rows));
  for (int i = 0; i < WINDOW_TILES; ++i) words[i] = transpose_groups(words[i]);
}

/// Numbers of sixteen tiles, counted from the first of them: of a window, and of one row.
struct TileLabels {
  alignas(64) uint32_t window[LANES];
  alignas(64) uint32_t row[LANES];
};

GSFW_FUNCTION void set_labels(int columns, TileLabels& labels) {
  for (int i = 0; i < LANES; ++i) {
    labels.window[i] = uint32_t(i / WINDOW_TILES * columns + i % WINDOW_TILES);
    labels.row[i] = uint32_t(i);
  }
}

/// Append the tiles that four words tell of, the first of which has number ``tile``.
GSFW_FUNCTION int append_tiles(const uint64_t* words, const uint32_t* labels, int tile,
                               const Intersections& to) {
  alignas(64) uint16_t blocks[LANES];
  memcpy(blocks, words, sizeof(blocks));
  return keep_nonzero(blocks, labels, uint32_t(tile), to.blocks, to.tiles);
}

/// Append the tiles of four rows, or up to ``rows``, where these are wider than a window: in the
/// order of the tiles' numbers. ``tile`` is the first of the first row.
template <typename T>
GSFW_FUNCTION int64_t append_wide(const Strips<T>& strips, int rows, const BlockRange& columns,
                                  const TileLabels& labels, const Grid& grid, int tile,
                                  const Intersections& to) {
  constexpr int SPAN = WINDOW_TILES * LANES;
  uint64_t windows[WINDOW_TILES][WINDOW_TILES], words[WINDOW_TILES];
  int found = -1;
  int64_t count = 0;
  for (int row = 0; row < WINDOW_TILES && row < rows; ++row, tile += grid.columns) {
    const int begin = columns.first / TILE_BLOCKS * TILE_BLOCKS;
    for (int block = begin; block <= columns.last; block += SPAN) {
      for (int i = 0; i < WINDOW_TILES; ++i) {
        if (found != block) find_window(strips, block + i * LANES, windows[i]);
        words[i] = windows[i][row];
      }
      found = block;
      count += append_tiles(words, labels.row, tile + block / TILE_BLOCKS,
                            {to.tiles + count, to.blocks + count});
    }
  }
  return count;
}

template <typename T>
GSFW_FUNCTION int64_t intersect_all(const BinJob<T>& job, const Intersections& to) {
  const int tiles = job.grid.columns * job.grid.rows;
  for (int tile = 0; tile < tiles; ++tile) {
    to.tiles[tile] = uint32_t(tile);
    to.blocks[tile] = (1u << BLOCKS) - 1u;
  }
  return tiles;
}

/// Append all intersections of one splat, in the order of the tiles' numbers; returns how many.
template <typename T>
GSFW_FUNCTION int64_t intersect_splat(const BinJob<T>& job, const T* splat,
                                      const TileLabels& labels, const Intersections& to) {
  const int across = (job.grid.width + BLOCK - 1) / BLOCK;
  const int down = (job.grid.height + BLOCK - 1) / BLOCK;
  const BlockRange rows = reached(splat[SPLAT_Y], splat[SPLAT_HEIGHT], down);
  const BlockRange columns = reached(splat[SPLAT_X], splat[SPLAT_WIDTH], across);
  const int first = columns.first / TILE_BLOCKS;
  int64_t count = 0;
  for (int strip = rows.first / TILE_BLOCKS * TILE_BLOCKS; strip <= rows.last; strip += LANES) {
    const Strips<T> strips = intersect_strips(splat, strip, rows, across);
    const int tile = strip / TILE_BLOCKS * job.grid.columns;
    if (columns.last / TILE_BLOCKS < first + WINDOW_TILES) {
      uint64_t words[WINDOW_TILES];
      find_window(strips, first * TILE_BLOCKS, words);
      count += append_tiles(words, labels.window, tile + first,
                            {to.tiles + count, to.blocks + count});
      continue;
    }
    const int left = (rows.last - strip) / TILE_BLOCKS + 1;
    count += append_wide(strips, left, columns, labels, job.grid, tile,
                         {to.tiles + count, to.blocks + count});
  }
  return count;
}

/// Append the intersections of the splats from rank ``begin`` to ``end``, one splat after the
/// other, and write how many each row has. ``to`` has room for 16 more than one splat may have per
/// rank.
template <typename T>
int64_t intersect(const BinJob<T>& job, int64_t begin, int64_t end, const Intersections& to) {
  constexpr int AHEAD = 12;
  TileLabels labels;
  set_labels(job.grid.columns, labels);
  int64_t count = 0;
  for (int64_t rank = begin; rank < end; ++rank) {
    if (rank + AHEAD < job.ranks) {
      __builtin_prefetch(job.projected + int64_t(job.order[rank + AHEAD]) * job.stride);
    }
    const uint32_t row = job.order[rank];
    const Intersections behind = {to.tiles + count, to.blocks + count};
    const int64_t more =
        job.bounded
            ? intersect_splat(job, job.projected + int64_t(row) * job.stride, labels, behind)
            : intersect_all(job, behind);
    job.counts[row] = uint32_t(more);
    count += more;
  }
  return count;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
