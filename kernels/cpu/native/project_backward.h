// Project, backward: from the sums that blending left in each splat's slots to its gradients.
#pragma once

#include "project.h"

namespace gsfw {
namespace GSFW_ISA {

/// Sum the slots of each visible row of a group, always in the same order: field k of lane i is
/// ``sums[16 k + i]``.
template <typename T>
GSFW_FUNCTION void sum_slots(const ProjectBackwardJob<T>& job, const RowGroup& rows,
                             uint32_t visible, T* sums) {
  const int stride = job.slot_stride;
  const uint32_t* starts = job.slot_starts + rows.first;
  const T* slots[LANES];
  uint32_t counts[LANES];
  for (int i = 0; i < LANES; ++i) {
    counts[i] = visible >> i & 1 ? starts[i + 1] - starts[i] : 0;
    slots[i] = counts[i] ? job.slots + int64_t(starts[i]) * stride : nullptr;
  }
  for (int k = 0; k < stride; k += LANES) {
    Pack<T> fields[LANES];
    for (int i = 0; i < LANES; ++i) {
      Pack<T> total(0.0);
      for (uint32_t s = 0; s < counts[i]; ++s) {
        total = total + load(slots[i] + int64_t(s) * stride + k);
      }
      fields[i] = total;
    }
    transpose(fields);
    for (int i = 0; i < LANES; ++i) store(sums + (k + i) * LANES, fields[i]);
  }
}

/// Writes gradients of a group of rows: 0 where they are not visible, or nothing if it adds.
template <typename T>
struct GradientWriter {
  RowGroup rows;
  LaneMask<T> seen;
  uint32_t visible;
  bool add;

  /// Fields of an array [n, FIELDS], if there is one.
  template <int FIELDS>
  GSFW_FUNCTION void write(T* array, const Pack<T>* gradient) const {
    if (!array) return;
    T* to = array + rows.first * FIELDS;
    Pack<T> values[FIELDS];
    if (add) load_rows<FIELDS>(to, rows.count, values);
    for (int k = 0; k < FIELDS; ++k) {
      const Pack<T> kept = keep(seen, gradient[k]);
      values[k] = add ? values[k] + kept : kept;
    }
    store_rows<FIELDS>(to, rows.count, values);
  }

  /// The same for one field of an array [n, stride].
  GSFW_FUNCTION void write_field(T* array, int stride, int field, const Pack<T>& gradient) const {
    T* to = array + rows.first * stride + field;
    const LaneMask<T> lanes = first_lanes<T>(rows.count);
    Pack<T> value = keep(seen, gradient);
    if (add) value = value + load_strided(to, stride, rows.count);
    store_strided(to, stride, lanes, value);
  }

  /// The first ``count`` fields of ``EvenRows`` or ``RaggedRows``; those behind them are 0.
  template <typename Rows>
  GSFW_FUNCTION void write_fields(const Rows& to, int count, Pack<T>* gradient) const {
    // All rows, because visibility cannot be predicted, and a branch for each row costs more.
    const uint32_t all = (1u << rows.count) - 1u;
    for (int k = 0; k < count; ++k) gradient[k] = keep(seen, gradient[k]);
    store_fields(to, add ? visible : all, 0, count, add, gradient);
    if (!to.all_end_at(count)) clear(to, all, count);
  }

  /// Zero the fields from ``first`` on of the rows whose bit is set in ``wanted``, unless it adds.
  template <typename Rows>
  GSFW_FUNCTION void clear(const Rows& to, uint32_t wanted, int first) const {
    for (int i = 0; i < rows.count && !add; ++i) {
      const int left = to.length(i) - first;
      if (wanted >> i & 1 && left > 0) memset(to.begin(i) + first, 0, left * sizeof(T));
    }
  }
};

/// The gradient of SH coefficients, and by the mean through the direction they are seen from;
/// RAGGED where splats have offsets. A call, as ``sh_colors`` is.
template <bool RAGGED, typename T>
[[gnu::noinline]] Vector3<Pack<T>> sh_backward(const ProjectBackwardJob<T>& job,
                                               const GradientWriter<T>& writer,
                                               const Vector3<Pack<T>>& mean,
                                               const Vector3<Pack<T>>& center,
                                               const Pack<T>* by_color) {
  using N = Pack<T>;
  const SplatArrays<T>& splats = job.forward.splats;
  const int degree = degree_of<RAGGED>(splats, writer.rows, writer.visible);
  const int count = num_coefficients(degree);
  N basis[SH_COEFFICIENTS], by_basis[SH_COEFFICIENTS], sums[3], by_sum[3];
  ShCoefficients<T> coefficients;
  const SplatGradients<T>& to = job.gradients;
  if (!RAGGED && to.rest) {
    ask_for_next<true>(to.rest, splats.count, splats.rest_stride, writer.rows);
  }
  const Vector3<N> direction = view_direction(mean, center);
  sh_basis(degree, direction, basis);
  load_sh<RAGGED>(splats, writer.rows, writer.visible, degree, coefficients);
  sum_sh(degree, coefficients, basis, sums);
  for (int c = 0; c < 3; ++c) by_sum[c] = sh_color_vjp(sums[c], by_color[c]);
  for (int k = 0; k < count; ++k) {
    N* field = coefficients.field + 3 * k;
    by_basis[k] = fma(by_sum[0], field[0], fma(by_sum[1], field[1], by_sum[2] * field[2]));
    for (int c = 0; c < 3; ++c) field[c] = basis[k] * by_sum[c];
  }
  // From here on the fields hold the gradient.
  if (RAGGED || splats.rest) {
    writer.template write<3>(to.colors, coefficients.field);
    if (to.rest) {
      const auto rest = rest_rows<RAGGED>(splats, to.rest, writer.rows);
      writer.write_fields(rest, 3 * (count - 1), coefficients.field + 3);
    }
  } else if (to.colors) {
    const auto colors = even_rows(to.colors, splats.color_stride, writer.rows);
    writer.write_fields(colors, 3 * count, coefficients.field);
  }
  if (degree == 0) return {N(0.0), N(0.0), N(0.0)};
  return view_direction_vjp(mean, center, sh_basis_vjp(degree, direction, by_basis));
}

/// Gradients by colours that are channels, by extra channels, and by depth, which is returned.
template <typename T>
GSFW_FUNCTION Pack<T> channels_backward(const ProjectBackwardJob<T>& job,
                                        const GradientWriter<T>& writer, const T* sums) {
  const SplatArrays<T>& splats = job.forward.splats;
  const T* channel = sums + SLOT_CHANNELS * LANES;
  if (splats.sh_degree < 0 && job.gradients.colors) {
    for (int c = 0; c < splats.color_channels; ++c) {
      writer.write_field(job.gradients.colors, splats.color_stride, c, load(channel + c * LANES));
    }
  }
  channel += splats.color_channels * LANES;
  for (int c = 0; c < splats.extras && job.gradients.extra; ++c) {
    writer.write_field(job.gradients.extra, splats.extras, c, load(channel + c * LANES));
  }
  channel += splats.extras * LANES;
  return splats.depth_channels > 0 ? load(channel) : Pack<T>(0.0);
}

template <typename T>
GSFW_FUNCTION void write_statistics(const ProjectBackwardJob<T>& job, const RowGroup& rows,
                                    LaneMask<T> seen, const Vector2<Pack<T>>& by_mean,
                                    const T* sums) {
  using N = Pack<T>;
  const N half_width(T(0.5) * T(job.forward.view.width));
  const N half_height(T(0.5) * T(job.forward.view.height));
  const auto write = [&](T* to, const N& x, const N& y) {
    const N across = x * half_width, down = y * half_height;
    store_strided(to + rows.first, 1, seen, square_root(fma(across, across, down * down)));
  };
  if (job.screen_gradient) write(job.screen_gradient, by_mean.x, by_mean.y);
  if (job.absgrad) {
    const SplatArrays<T>& splats = job.forward.splats;
    const int channels = splats.color_channels + splats.extras + splats.depth_channels;
    const T* magnitudes = sums + (SLOT_CHANNELS + channels) * LANES;
    const N unscale(1.0 / (binary_scale * binary_scale));
    write(job.absgrad, unscale * load(magnitudes), unscale * load(magnitudes + LANES));
  }
}

template <typename T>
GSFW_FUNCTION void write_shape(const SplatGradients<T>& to, const GradientWriter<T>& writer,
                               const Axes<Pack<T>>& gradient) {
  const auto& q = gradient.rotation;
  const Pack<T> quats[4] = {q.w, q.x, q.y, q.z};
  writer.template write<4>(to.quats, quats);
  const Pack<T> scales[3] = {gradient.scales.x, gradient.scales.y, gradient.scales.z};
  writer.template write<3>(to.scales, scales);
}

template <typename T>
GSFW_FUNCTION void write_shape(const SplatGradients<T>& to, const GradientWriter<T>& writer,
                               const Symmetric3<Pack<T>>& gradient) {
  if (!to.covariances) return;
  const Pack<T> entries[9] = {gradient.xx, gradient.xy, gradient.xz, gradient.xy, gradient.yy,
                              gradient.yz, gradient.xz, gradient.yz, gradient.zz};
  for (int k = 0; k < 9; ++k) writer.write_field(to.covariances, 9, k, entries[k]);
}

/// Sums of the pose gradient over the rows of a task, lane by lane.
template <typename T>
struct PoseSums {
  Pack<T> field[POSE_FIELDS];

  GSFW_FUNCTION void add(int at, LaneMask<T> lanes, const Vector3<Pack<T>>& v) {
    field[at] = field[at] + keep(lanes, v.x);
    field[at + 1] = field[at + 1] + keep(lanes, v.y);
    field[at + 2] = field[at + 2] + keep(lanes, v.z);
  }

  template <typename Gradient>
  GSFW_FUNCTION void add(LaneMask<T> lanes, const Gradient& pose,
                         const Vector3<Pack<T>>& by_center) {
    add(0, lanes, pose.rotation.x);
    add(3, lanes, pose.rotation.y);
    add(6, lanes, pose.rotation.z);
    add(9, lanes, pose.translation);
    add(12, lanes, by_center);
  }
};

/// Gradients of a group of projected Gaussians from the sums of blending.
template <typename T>
GSFW_FUNCTION ProjectionGradient<Pack<T>> gradient_of(const Projection<Pack<T>>& splat,
                                                      const T* sums) {
  using N = Pack<T>;
  const auto sum_of = [&](int field) { return load(sums + field * LANES); };
  const Moments<N> moments = unscale_from_binary(
      Moments<N>{sum_of(SLOT_G),
                 {sum_of(SLOT_U), sum_of(SLOT_V)},
                 {sum_of(SLOT_UU), sum_of(SLOT_UV), sum_of(SLOT_VV)}});
  const Whitening<N> whitening = whiten(splat.covariance, splat.determinant);
  return {mean_vjp(whitening, moments.first), N(0.0), moments.second,
          moments.n / maximum(splat.opacity, N(OPACITY_MIN))};
}

/// The gradients of a group of rows, from their summed slots.
template <typename T, typename Shape>
GSFW_FUNCTION void group_backward(const ProjectBackwardJob<T>& job, const GradientWriter<T>& writer,
                                  const Shape& shape, const Camera<Pack<T>>& camera,
                                  const Settings<Pack<T>>& settings, const T* sums,
                                  PoseSums<T>& pose) {
  using N = Pack<T>;
  const SplatArrays<T>& splats = job.forward.splats;
  const RowGroup& rows = writer.rows;
  const Vector3<N> mean = load_vector(splats.means, rows);
  const N opacity = load_strided(splats.opacities + rows.first, 1, rows.count);
  ProjectionGradient<N> seen =
      gradient_of(project(mean, shape, opacity, camera, settings), sums);
  write_statistics(job, rows, writer.seen, seen.mean, sums);
  seen.depth = channels_backward(job, writer, sums);
  GaussianGradient<N, Shape> gradient = project_vjp(mean, shape, opacity, camera, settings, seen);
  Vector3<N> by_center{N(0.0), N(0.0), N(0.0)};
  if (splats.sh_degree >= 0) {
    const T* colors = sums + SLOT_CHANNELS * LANES;
    const N by_color[3] = {load(colors), load(colors + LANES), load(colors + 2 * LANES)};
    const Vector3<N> center = camera_center(camera);
    const Vector3<N> turned = splats.offsets
                                  ? sh_backward<true>(job, writer, mean, center, by_color)
                                  : sh_backward<false>(job, writer, mean, center, by_color);
    gradient.mean = gradient.mean + turned;
    by_center = -turned;
  }
  const N by_mean[3] = {gradient.mean.x, gradient.mean.y, gradient.mean.z};
  writer.template write<3>(job.gradients.means, by_mean);
  if (job.gradients.opacities) {
    writer.write_field(job.gradients.opacities, 1, 0, gradient.opacity);
  }
  write_shape(job.gradients, writer, gradient.shape);
  if (job.pose) pose.add(writer.seen, gradient.pose, by_center);
}

/// Zero the gradients of a group of rows none of which is visible.
template <typename T>
GSFW_FUNCTION void clear_group(const ProjectBackwardJob<T>& job, const GradientWriter<T>& writer) {
  const SplatArrays<T>& splats = job.forward.splats;
  const SplatGradients<T>& to = job.gradients;
  const auto clear = [&](T* array, int stride) {
    if (array) writer.clear(even_rows(array, stride, writer.rows), ~0u, 0);
  };
  clear(to.means, 3);
  clear(to.quats, 4);
  clear(to.scales, 3);
  clear(to.covariances, 9);
  clear(to.opacities, 1);
  clear(to.colors, splats.color_stride);
  clear(to.extra, splats.extras);
  if (to.rest && splats.offsets) {
    writer.clear(rest_rows<true>(splats, to.rest, writer.rows), ~0u, 0);
  } else {
    clear(to.rest, splats.rest_stride);
  }
}

/// The gradients of rows ``begin`` to ``end``; ``sums`` has room for 16 rows of summed slots.
template <typename T>
void project_backward_task(const ProjectBackwardJob<T>& job, int64_t begin, int64_t end, T* sums) {
  const Camera<Pack<T>> camera = camera_of(job.forward.view);
  const Settings<Pack<T>> settings = settings_of(job.forward.view);
  PoseSums<T> pose;
  for (int k = 0; k < POSE_FIELDS; ++k) pose.field[k] = Pack<T>(0.0);
  for (int64_t row = begin; row < end; row += LANES) {
    const RowGroup rows = rows_from(row, end);
    uint32_t visible = 0;
    for (int i = 0; i < rows.count; ++i) visible |= uint32_t(job.forward.visible[row + i]) << i;
    const GradientWriter<T> writer{rows, lanes_of<T>(visible), visible, job.accumulate};
    if (!visible) {
      clear_group(job, writer);
      continue;
    }
    sum_slots(job, rows, visible, sums);
    if (job.forward.splats.covariances) {
      group_backward(job, writer, load_covariances(job.forward.splats, rows), camera, settings,
                     sums, pose);
    } else {
      group_backward(job, writer, load_axes(job.forward.splats, rows), camera, settings, sums,
                     pose);
    }
  }
  if (!job.pose) return;
  T* to = job.pose + begin / ROWS_PER_TASK * POSE_FIELDS;
  for (int k = 0; k < POSE_FIELDS; ++k) to[k] = sum(pose.field[k]);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
