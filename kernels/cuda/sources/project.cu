// Project: from splats to projected splats, the ellipses with which one camera's image is blended.
//
// One thread per row of the model. Threads beyond the last row repeat it and write nothing, since
// all lanes of a warp take part when it fetches coefficients and counts tiles.
#include "stages.h"

#include "coefficients.h"
#include "reach.h"
#include "splat.h"
#include "view.h"

namespace gsfw {
namespace cuda {

/// Blocks that registers must leave room for on a multiprocessor: what is short here is memory, for
/// which more threads wait in parallel. With this many, no number is kept in local memory: a ragged
/// row's place in its array takes registers too.
template <class T, bool RAGGED>
constexpr int PROJECT_BLOCKS = sizeof(T) != sizeof(float) ? 8 : RAGGED ? 10 : 12;

/// A positive depth as a number that sorts alike.
GSFW_FUNCTION uint32 depth_key(float depth) { return __float_as_uint(depth); }
GSFW_FUNCTION uint64 depth_key(double depth) { return uint64(__double_as_longlong(depth)); }

/// The channels of one row, one after the other.
template <class T, int DEGREE>
struct ChannelReader {
  const SplatArrays& splats;
  int64 row;
  /// Colour of the SH, already clamped.
  Vector3<T> sh_color;
  T depth;

  /// Zero beyond those that are rendered.
  GSFW_FUNCTION T operator[](int channel) const {
    const int extra = channel - splats.color_channels, beyond = extra - splats.extras;
    if (extra < 0 && DEGREE >= 0) {
      return channel == 0 ? sh_color.x : channel == 1 ? sh_color.y : sh_color.z;
    }
    if (extra < 0) return static_cast<const T*>(splats.colors)[row * splats.color_stride + channel];
    if (beyond < 0) return static_cast<const T*>(splats.extra)[row * splats.extras + extra];
    if (beyond >= splats.depth_channels) return T(0);
    return beyond == 0 ? depth : T(1);
  }
};

/// Write a projected splat: [stride] numbers, of which ``fields`` has those of the ellipse.
template <class T, int DEGREE>
GSFW_FUNCTION void write_splat(const T* fields, const ChannelReader<T, DEGREE>& channel, int stride,
                               void* projected) {
  static_assert(SPLAT_CHANNELS % 4 == 3, "The third four ends with the first channel.");
  constexpr int FULL = SPLAT_CHANNELS / 4;
  Four<T>* to = reinterpret_cast<Four<T>*>(static_cast<T*>(projected) + channel.row * stride);
#pragma unroll
  for (int i = 0; i < FULL; ++i) {
    to[i] = {{fields[4 * i], fields[4 * i + 1], fields[4 * i + 2], fields[4 * i + 3]}};
  }
  to[FULL] = {{fields[4 * FULL], fields[4 * FULL + 1], fields[4 * FULL + 2], channel[0]}};
  for (int i = FULL + 1; 4 * i < stride; ++i) {
    const int next = 4 * i - SPLAT_CHANNELS;
    to[i] = {{channel[next], channel[next + 1], channel[next + 2], channel[next + 3]}};
  }
}

/// The colour of this thread's row: max(0, 0.5 + sum of coefficient times basis). Reached by all
/// lanes.
template <int DEGREE, bool RAGGED, class T>
__device__ __forceinline__ Vector3<T> sh_color_of(const SplatArrays& splats, const WarpRows& rows,
                                                  const Vector3<T>& mean,
                                                  const Camera<T>& camera) {
  __shared__ Coefficients<T, DEGREE> staged[PROJECT_THREADS / WARP];
  Coefficients<T, DEGREE>& coefficients = staged[warp_index()];
  fetch<RAGGED>(splats, rows, coefficients);
  T basis[num_coefficients(DEGREE)];
  sh_basis(DEGREE, view_direction(mean, camera_center(camera)), basis);
  const Vector3<T> sum = sum_bands<DEGREE>(coefficients.rows[lane_index()], basis);
  return {sh_color(sum.x), sh_color(sum.y), sh_color(sum.z)};
}

/// Write the results of a row besides its projected splat.
template <class T>
GSFW_FUNCTION void write_row(const ProjectJob& job, int64 row, bool visible, int tiles,
                             const Projection<T>& splat, const Extent<T>& extent) {
  using Key = decltype(depth_key(splat.depth));
  job.visible[row] = visible;
  job.tile_counts[row] = tiles;
  static_cast<T*>(job.radii)[row] = visible ? maximum(extent.half.x, extent.half.y) : T(0);
  static_cast<Key*>(job.depth_keys)[row] = visible ? depth_key(splat.depth) : ~Key(0);
}

/// project<T, Shape, DEGREE, RAGGED>: see ProjectJob. Shape is Axes<T> or Symmetric3<T>; DEGREE
/// that of the spherical harmonics, -1 for colours that are plain channels; RAGGED where there are
/// offsets, from degree 1 on. Blocks of PROJECT_THREADS.
template <class T, class Shape, int DEGREE, bool RAGGED>
__global__ void __launch_bounds__(PROJECT_THREADS, (PROJECT_BLOCKS<T, RAGGED>))
    project(ProjectJob job) {
  const int64 row = thread_index();
  const bool inside = row < job.splats.count;
  // On its way while the block waits for its camera.
  const Splat<T, Shape> splat =
      load_splat<T, Shape>(job.splats, inside ? row : job.splats.count - 1);
  const Camera<T>& camera = camera_of_block<T>(job.view, job.grid);
  const Settings<T> settings = settings_of<T>(job.view);
  const Projection<T> seen = project(splat.mean, splat.shape, splat.opacity, camera, settings);
  const T level = logarithm_of_two(maximum(seen.opacity, T(OPACITY_MIN)));
  const T log_visibility = T(0.6931471805599453) * (level - T(job.level_min));
  const Extent<T> extent = visible_extent(seen, log_visibility, camera, settings);
  const bool visible = inside && extent.visible;

  ChannelReader<T, DEGREE> channels{job.splats, row, {}, seen.depth};
  if constexpr (DEGREE >= 0) {
    const WarpRows rows = rows_of_warp(row, inside, visible);
    channels.sh_color = sh_color_of<DEGREE, RAGGED>(job.splats, rows, splat.mean, camera);
  }
  T fields[SPLAT_CHANNELS];
  ellipse_fields(seen, level, log_visibility, extent, fields);
  if (visible) write_splat(fields, channels, job.stride, job.projected);
  const int tiles = count_tiles(fields, visible, job.grid, job.bounded != 0);
  if (inside) write_row(job, row, visible, tiles, seen, extent);
}

}  // namespace cuda
}  // namespace gsfw
