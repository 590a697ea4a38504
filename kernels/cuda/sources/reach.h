// Reach: which tiles, and which subtiles of a tile, an ellipse intersects.
//
// An ellipse cut by a strip of pixel rows spans an interval of x, because the cut is convex; a
// rectangle of that strip is reached if and only if its pixel centres overlap the interval. Binning
// counts tiles in one kernel and emits them in another, and both must find the same ones to the
// bit: hence no sum here that a compiler could fuse with whatever made its operands.
#pragma once

#include "stages.h"

namespace gsfw {
namespace cuda {

/// Pixels, and 1/100 of it per pixel of extent, by which rounding may not shrink an ellipse.
constexpr double SLACK = 1e-3;
/// Splats of more tile rows than this are counted by a whole warp.
constexpr int ROWS_BY_ONE_LANE = 8;

/// An interval of x in pixels; empty where low > high.
template <class T>
struct Span {
  T low, high;
};

/// Rows or columns of tiles, the last one included; none where last < first.
struct TileRange {
  int first, last;
};

__device__ __forceinline__ int length(const TileRange& range) {
  return range.last < range.first ? 0 : range.last - range.first + 1;
}

/// The fields of a projected splat that tell what it intersects.
template <class T>
struct Ellipse {
  /// The centre, in pixels.
  T x, y;
  /// As SplatField has them.
  T tilt, turn, narrow, height, width;
  /// 1 / height.
  T shrink;
};

/// a + b, rounded before anything else is done with it.
__device__ __forceinline__ float rounded_sum(float a, float b) {
#ifdef __CUDA_ARCH__
  return __fadd_rn(a, b);
#else
  return a + b;
#endif
}
__device__ __forceinline__ double rounded_sum(double a, double b) {
#ifdef __CUDA_ARCH__
  return __dadd_rn(a, b);
#else
  return a + b;
#endif
}

__device__ __forceinline__ float round_down(float x) { return GSFW_ELEMENTARY(floorf)(x); }
__device__ __forceinline__ double round_down(double x) { return GSFW_ELEMENTARY(floor)(x); }

template <class T>
__device__ __forceinline__ Ellipse<T> ellipse_of(const T* splat) {
  const T height = splat[SPLAT_HEIGHT];
  return {splat[SPLAT_X],    splat[SPLAT_Y],      splat[SPLAT_TILT], splat[SPLAT_TURN],
          splat[SPLAT_NARROW], height, splat[SPLAT_WIDTH], T(1) / height};
}

/// The ellipse that lane ``lane`` holds. A warp collective; lanes may ask for different ones.
template <class T>
__device__ __forceinline__ Ellipse<T> from_lane(const Ellipse<T>& own, int lane) {
  return {__shfl_sync(FULL_WARP, own.x, lane),      __shfl_sync(FULL_WARP, own.y, lane),
          __shfl_sync(FULL_WARP, own.tilt, lane),   __shfl_sync(FULL_WARP, own.turn, lane),
          __shfl_sync(FULL_WARP, own.narrow, lane), __shfl_sync(FULL_WARP, own.height, lane),
          __shfl_sync(FULL_WARP, own.width, lane),  __shfl_sync(FULL_WARP, own.shrink, lane)};
}

/// Margin beyond half the extent of an ellipse that counts as reached, in pixels.
template <class T>
__device__ __forceinline__ T slack_of(T extent) {
  return fma(T(0.01 * SLACK), extent, T(SLACK));
}

/// The square root of a number that is 0 or far from subnormal, right to 2 units in the last place,
/// which is much less than the slack.
__device__ __forceinline__ float rough_root(float x) {
#ifdef __CUDA_ARCH__
  // One instruction; a root that is right to the last bit takes eight and a branch.
  float root;
  asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(x));
  return root;
#else
  return square_root(x);
#endif
}
__device__ __forceinline__ double rough_root(double x) { return square_root(x); }

/// ``x``, or the nearer end of the interval from ``low`` to ``high`` beyond which it lies.
template <class T>
__device__ __forceinline__ T clipped(T x, T low, T high) {
  return least(greatest(x, low), high);
}

/// Half the width of an ellipse ``height`` pixels above its centre, in units of ``narrow``.
template <class T>
__device__ __forceinline__ T half_width(const Ellipse<T>& ellipse, T height) {
  // An ellipse that is a point has 0 / 0 here, which greatest turns into 0.
  const T part = height * ellipse.shrink;
  return rough_root(greatest(fma(-part, part, T(1)), T(0)));
}

/// The interval of x that an ellipse covers between the pixel-centre heights ``top`` and ``bottom``
/// (absolute, both included), slack included.
template <class T>
__device__ __forceinline__ Span<T> span_of_rows(const Ellipse<T>& ellipse, T top, T bottom) {
  const T height = ellipse.height, reach = rounded_sum(height, slack_of(height));
  const T from = rounded_sum(top, -ellipse.y), to = rounded_sum(bottom, -ellipse.y);
  if (from > reach || to < -reach) return {T(1e30), T(-1e30)};
  // Within a strip the ellipse is widest where it turns, or else at the nearer edge of the strip.
  const T low = clipped(from, -height, height), high = clipped(to, -height, height);
  const T at_right = clipped(ellipse.turn, low, high);
  const T at_left = clipped(-ellipse.turn, low, high);
  const T right = fma(ellipse.narrow, half_width(ellipse, at_right), ellipse.tilt * at_right);
  const T left = fma(-ellipse.narrow, half_width(ellipse, at_left), ellipse.tilt * at_left);
  const T slack = slack_of(ellipse.width);
  return {rounded_sum(rounded_sum(ellipse.x, left), -slack),
          rounded_sum(rounded_sum(ellipse.x, right), slack)};
}

/// The same for a projected splat, in any memory.
template <class T>
__device__ __forceinline__ Span<T> span_of_rows(const T* splat, T top, T bottom) {
  return span_of_rows(ellipse_of(splat), top, bottom);
}

/// The subtiles that a splat may reach in the tile whose first pixel is (tile_x, tile_y): bit row *
/// 2 + column for each subtile, all of them where splats are not bounded. Misses no pixel at which
/// alpha reaches its minimum.
template <class T>
__device__ __forceinline__ uint32 subtiles_reached(const T* splat, int tile_x, int tile_y,
                                               bool bounded) {
  if (!bounded) return (1u << SUBTILES) - 1u;
  const Ellipse<T> ellipse = ellipse_of(splat);
  const T first = T(tile_x) + T(0.5), second = first + T(SUBTILE_WIDTH);
  uint32 reached = 0;
#pragma unroll
  for (int row = 0; row < TILE / SUBTILE_HEIGHT; ++row) {
    const T top = T(tile_y + row * SUBTILE_HEIGHT) + T(0.5);
    const Span<T> span = span_of_rows(ellipse, top, top + T(SUBTILE_HEIGHT - 1));
    if (span.high >= first && span.low <= first + T(SUBTILE_WIDTH - 1)) reached |= 1u << (2 * row);
    if (span.high >= second && span.low <= second + T(SUBTILE_WIDTH - 1)) {
      reached |= 2u << (2 * row);
    }
  }
  return reached;
}

/// The tiles along an axis, of ``tiles``, some of whose pixel centres lie between ``low`` and
/// ``high`` (pixels).
template <class T>
__device__ __forceinline__ TileRange tiles_between(T low, T high, int tiles) {
  const T first = -round_down((T(TILE - 0.5) - low) * T(1.0 / TILE));
  const T last = round_down((high - T(0.5)) * T(1.0 / TILE));
  // Clamped before they become integers, which hold no infinity.
  return {int(clipped(first, T(0), T(tiles))), int(clipped(last, T(-1), T(tiles - 1)))};
}

/// The rows of tiles that an ellipse may intersect.
template <class T>
__device__ __forceinline__ TileRange tile_rows(const Ellipse<T>& ellipse, const Grid& grid) {
  const T reach = rounded_sum(ellipse.height, slack_of(ellipse.height));
  return tiles_between(rounded_sum(ellipse.y, -reach), rounded_sum(ellipse.y, reach), grid.rows);
}

/// The columns of tiles that an ellipse intersects in one row of tiles.
template <class T>
__device__ __forceinline__ TileRange tile_columns(const Ellipse<T>& ellipse, int row,
                                                  const Grid& grid) {
  const T top = T(row * TILE) + T(0.5);
  const Span<T> span = span_of_rows(ellipse, top, top + T(TILE - 1));
  return tiles_between(span.low, span.high, grid.columns);
}

/// Number of tiles that a splat intersects; 0 if not ``visible``.
///
/// A warp collective. ``splat`` is an array of the lane's own; each lane counts its own splat, but
/// tall ones are counted by the whole warp, one after the other, lest one lane keep 31 waiting.
template <class T>
__device__ __forceinline__ int count_tiles(const T* splat, bool visible, const Grid& grid,
                                           bool bounded) {
  if (!bounded) return visible ? grid.columns * grid.rows : 0;
  const Ellipse<T> own = ellipse_of(splat);
  TileRange rows{0, -1};
  if (visible) rows = tile_rows(own, grid);
  const bool tall = length(rows) > ROWS_BY_ONE_LANE;
  int count = 0;
  for (int row = rows.first; !tall && row <= rows.last; ++row) {
    count += length(tile_columns(own, row, grid));
  }
  for (uint32 left = __ballot_sync(FULL_WARP, tall); left != 0; left &= left - 1) {
    const int lane = __ffs(int(left)) - 1;
    const Ellipse<T> ellipse = from_lane(own, lane);
    const int last = __shfl_sync(FULL_WARP, rows.last, lane);
    int part = 0;
    for (int row = __shfl_sync(FULL_WARP, rows.first, lane) + lane_index(); row <= last;
         row += WARP) {
      part += length(tile_columns(ellipse, row, grid));
    }
    part = warp_sum(part);
    if (lane_index() == lane) count = part;
  }
  return count;
}

}  // namespace cuda
}  // namespace gsfw
