// Project: from splats to projected splats, the ellipses with which one camera's image is blended.
#pragma once

#include "view.h"

namespace gsfw {
namespace GSFW_ISA {

/// The channels of a group of rows, one after the other.
template <typename T>
struct ChannelReader {
  const SplatArrays<T>& splats;
  RowGroup rows;
  /// Colour of the SH, already clamped.
  Vector3<Pack<T>> sh_color;
  Pack<T> depth;

  GSFW_FUNCTION Pack<T> operator[](int channel) const {
    const int extra = channel - splats.color_channels, beyond = extra - splats.extras;
    if (extra < 0 && splats.sh_degree >= 0) {
      return channel == 0 ? sh_color.x : channel == 1 ? sh_color.y : sh_color.z;
    }
    if (extra < 0) {
      return load_strided(splats.colors + rows.first * splats.color_stride + channel,
                          splats.color_stride, rows.count);
    }
    if (beyond < 0) {
      return load_strided(splats.extra + rows.first * splats.extras + extra, splats.extras,
                          rows.count);
    }
    return beyond == 0 ? depth : Pack<T>(1.0);
  }
};

/// The colours of a group of rows: max(0, 0.5 + sum of coefficient times basis). RAGGED where
/// splats have offsets. A call, which is faster than the two of them inline.
template <bool RAGGED, typename T>
[[gnu::noinline]] Vector3<Pack<T>> sh_colors(const SplatArrays<T>& splats, const RowGroup& rows,
                                             uint32_t visible,
                                             const Vector3<Pack<T>>& direction) {
  Pack<T> basis[SH_COEFFICIENTS], sums[3];
  ShCoefficients<T> coefficients;
  const int degree = degree_of<RAGGED>(splats, rows, visible);
  sh_basis(degree, direction, basis);
  load_sh<RAGGED>(splats, rows, visible, degree, coefficients);
  sum_sh(degree, coefficients, basis, sums);
  return {sh_color(sums[0]), sh_color(sums[1]), sh_color(sums[2])};
}

/// Write the projected splats of a group of rows where they are visible; ``fields`` has the fields
/// of the ellipse.
template <typename T>
GSFW_FUNCTION void write_splats(const ProjectJob<T>& job, const RowGroup& rows, uint32_t visible,
                                 const ChannelReader<T>& channel, Pack<T>* fields) {
  const SplatArrays<T>& splats = job.splats;
  const int channels = splats.color_channels + splats.extras + splats.depth_channels;
  const EvenRows<T> projected = even_rows(job.projected, job.stride, rows);
  int next = 0;
  for (int block = 0; block < job.stride; block += LANES) {
    for (int k = block == 0 ? int(SPLAT_CHANNELS) : 0; k < LANES; ++k) {
      fields[k] = next < channels ? channel[next] : Pack<T>(0.0);
      ++next;
    }
    store_fields(projected, visible, block, block + LANES, false, fields);
  }
}

/// Project a group of rows.
template <typename T, typename Shape>
GSFW_FUNCTION void project_rows(const ProjectJob<T>& job, const Camera<Pack<T>>& camera,
                                const Settings<Pack<T>>& settings, const RowGroup& rows,
                                const Shape& shape) {
  using N = Pack<T>;
  const Vector3<N> mean = load_vector(job.splats.means, rows);
  const N opacity = load_strided(job.splats.opacities + rows.first, 1, rows.count);
  const Projection<N> splat = project(mean, shape, opacity, camera, settings);
  const N level = logarithm_of_two(maximum(splat.opacity, N(OPACITY_MIN)));
  const N log_visibility = N(0.6931471805599453) * (level - N(job.level_min));
  const Extent<N> extent = visible_extent(splat, log_visibility, camera, settings);
  const LaneMask<T> lanes = first_lanes<T>(rows.count);
  const LaneMask<T> seen = extent.visible & lanes;
  const uint32_t visible = bits_of(seen);
  for (int i = 0; i < rows.count; ++i) job.visible[rows.first + i] = visible >> i & 1;
  store_strided(job.radii + rows.first, 1, lanes,
                keep(seen, maximum(extent.half.x, extent.half.y)));
  if (!visible) return;
  store_strided(job.depths + rows.first, 1, seen, splat.depth);
  ChannelReader<T> channels{job.splats, rows, {}, splat.depth};
  if (job.splats.sh_degree >= 0) {
    const Vector3<N> direction = view_direction(mean, camera_center(camera));
    channels.sh_color = job.splats.offsets
                            ? sh_colors<true>(job.splats, rows, visible, direction)
                            : sh_colors<false>(job.splats, rows, visible, direction);
  }
  N fields[LANES];
  ellipse_fields(splat, level, log_visibility, extent, fields);
  write_splats(job, rows, visible, channels, fields);
}

/// Project rows ``begin`` to ``end``.
template <typename T>
void project_task(const ProjectJob<T>& job, int64_t begin, int64_t end) {
  const Camera<Pack<T>> camera = camera_of(job.view);
  const Settings<Pack<T>> settings = settings_of(job.view);
  for (int64_t row = begin; row < end; row += LANES) {
    const RowGroup rows = rows_from(row, end);
    if (job.splats.covariances) {
      project_rows(job, camera, settings, rows, load_covariances(job.splats, rows));
    } else {
      project_rows(job, camera, settings, rows, load_axes(job.splats, rows));
    }
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
