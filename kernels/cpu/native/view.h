// View: a job's parameters as the shared maths wants them, and rows of arrays as packs.
#pragma once

#include "projection.h"
#include "simd/simd.h"
#include "spherical_harmonics.h"
#include "stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Smaller opacities count as this, whose logarithm is finite.
constexpr double OPACITY_MIN = 7.888609052210118e-31;

template <typename T>
GSFW_FUNCTION Camera<Pack<T>> camera_of(const ViewParameters<T>& view) {
  using N = Pack<T>;
  const T* m = view.world_to_camera;
  Camera<N> camera;
  camera.model = static_cast<CameraModel>(view.model);
  camera.rotation = {{N(m[0]), N(m[1]), N(m[2])},
                     {N(m[4]), N(m[5]), N(m[6])},
                     {N(m[8]), N(m[9]), N(m[10])}};
  camera.translation = {N(m[3]), N(m[7]), N(m[11])};
  camera.focal = {N(view.focal_x), N(view.focal_y)};
  camera.principal = {N(view.principal_x), N(view.principal_y)};
  camera.size = {N(T(view.width)), N(T(view.height))};
  set_slope_limits(camera, N(view.jacobian_margin));
  return camera;
}

template <typename T>
GSFW_FUNCTION Settings<Pack<T>> settings_of(const ViewParameters<T>& view) {
  using N = Pack<T>;
  return {N(view.dilation),
          N(view.compensation_min),
          N(view.alpha_min),
          N(view.near),
          N(view.far),
          N(view.length_max),
          N(view.quaternion_min_norm),
          view.antialias,
          view.alpha_min > T(0)};
}

/// Sixteen rows of the model that follow one another, or as many as there are.
struct RowGroup {
  int64_t first;
  int count;
};

GSFW_FUNCTION RowGroup rows_from(int64_t row, int64_t end) {
  return {row, int(end - row < LANES ? end - row : LANES)};
}

template <typename T>
GSFW_FUNCTION Vector3<Pack<T>> load_vector(const T* array, const RowGroup& rows) {
  Pack<T> v[3];
  load_rows<3>(array + rows.first * 3, rows.count, v);
  return {v[0], v[1], v[2]};
}

template <typename T>
GSFW_FUNCTION Axes<Pack<T>> load_axes(const SplatArrays<T>& splats, const RowGroup& rows) {
  Pack<T> q[4];
  load_rows<4>(splats.quats + rows.first * 4, rows.count, q);
  return {{q[0], q[1], q[2], q[3]}, load_vector(splats.scales, rows)};
}

/// The symmetric part of each covariance, which is all that its projection depends on.
template <typename T>
GSFW_FUNCTION Symmetric3<Pack<T>> load_covariances(const SplatArrays<T>& splats,
                                                   const RowGroup& rows) {
  const auto entry = [&](int k) {
    return load_strided(splats.covariances + rows.first * 9 + k, 9, rows.count);
  };
  const Pack<T> half(0.5);
  return {entry(0), half * (entry(1) + entry(3)), half * (entry(2) + entry(6)),
          entry(4), half * (entry(5) + entry(7)), entry(8)};
}

/// Rows of an array [n, stride].
template <typename T>
struct EvenRows {
  T* first;
  int stride;

  GSFW_FUNCTION T* begin(int i) const { return first + int64_t(i) * stride; }
  GSFW_FUNCTION int length(int) const { return stride; }
  GSFW_FUNCTION bool all_end_at(int count) const { return count == stride; }
  /// Number of values of a row from ``first`` to ``last``, which is not beyond its end.
  GSFW_FUNCTION int between(int, int first, int last) const { return last - first; }
};

template <typename T>
GSFW_FUNCTION EvenRows<T> even_rows(T* array, int stride, const RowGroup& rows) {
  return {array + rows.first * stride, stride};
}

/// Rows of a ragged array [m, 3]; see ``SplatArrays::offsets``.
template <typename T>
struct RaggedRows {
  T* array;
  /// From the group's first row on.
  const int64_t* offsets;

  GSFW_FUNCTION T* begin(int i) const { return array + 3 * offsets[i]; }
  GSFW_FUNCTION int length(int i) const { return 3 * int(offsets[i + 1] - offsets[i]); }
  GSFW_FUNCTION bool all_end_at(int) const { return false; }
  GSFW_FUNCTION int between(int i, int first, int last) const {
    const int all = length(i), end = all < last ? all : last;
    return end > first ? end - first : 0;
  }
};

/// Fields ``first`` to ``last`` of the rows whose bit is set in ``wanted``; the others, and what a
/// row does not have, are 0 and not read. Writes whole groups of sixteen packs.
template <typename Rows, typename T>
GSFW_FUNCTION void load_fields(const Rows& rows, uint32_t wanted, int first, int last,
                               Pack<T>* fields) {
  for (int k = first; k < last; k += LANES, fields += LANES) {
    for (int i = 0; i < LANES; ++i) {
      fields[i] = wanted >> i & 1 ? load_strided(rows.begin(i) + k, 1, rows.between(i, k, last))
                                  : Pack<T>(0.0);
    }
    transpose(fields);
  }
}

/// Write fields ``first`` to ``last`` of the rows whose bit is set in ``wanted``, as far as they
/// have them, or add to them. Reads whole groups of sixteen packs, and spoils them.
template <typename Rows, typename T>
GSFW_FUNCTION void store_fields(const Rows& rows, uint32_t wanted, int first, int last, bool add,
                                Pack<T>* fields) {
  for (int k = first; k < last; k += LANES, fields += LANES) {
    transpose(fields);
    for (int i = 0; i < LANES; ++i) {
      if (!(wanted >> i & 1)) continue;
      T* to = rows.begin(i) + k;
      const int count = rows.between(i, k, last);
      const Pack<T> value = add ? fields[i] + load_strided(to, 1, count) : fields[i];
      store_strided(to, 1, first_lanes<T>(count), value);
    }
  }
}

/// Most SH coefficients, and room for three channels of them in whole groups of packs.
constexpr int SH_COEFFICIENTS = 25;
constexpr int SH_FIELDS = (3 * SH_COEFFICIENTS + LANES - 1) / LANES * LANES + LANES;

/// SH coefficients of a group of rows: channel c of coefficient k is ``field[3 k + c]``.
template <typename T>
struct ShCoefficients {
  Pack<T> field[SH_FIELDS];
};

/// The rows of ``rest``, or of its gradient; RAGGED where splats have offsets.
template <bool RAGGED, typename Number, typename T>
GSFW_FUNCTION auto rest_rows(const SplatArrays<T>& splats, Number* rest, const RowGroup& rows) {
  if constexpr (RAGGED) {
    return RaggedRows<Number>{rest, splats.offsets + rows.first};
  } else {
    return even_rows(rest, splats.rest_stride, rows);
  }
}

/// The active degree; of ragged rows the highest that any in ``wanted`` has, if it is less.
template <bool RAGGED, typename T>
GSFW_FUNCTION int degree_of(const SplatArrays<T>& splats, const RowGroup& rows, uint32_t wanted) {
  if constexpr (!RAGGED) return splats.sh_degree;
  const auto rest = rest_rows<true>(splats, splats.rest, rows);
  int longest = 0, degree = 0;
  for (uint32_t left = wanted; left; left &= left - 1) {
    const int length = rest.length(__builtin_ctz(left));
    longest = length > longest ? length : longest;
  }
  while (degree < splats.sh_degree && 3 * num_coefficients(degree) < 3 + longest) ++degree;
  return degree;
}

/// Ask for the next group of rows in an array of ``count`` rows while this group is worked on: of
/// long rows the processor does not read far enough ahead by itself.
template <bool WRITTEN, typename T>
GSFW_FUNCTION void ask_for_next(const T* array, int64_t count, int stride, const RowGroup& rows) {
  constexpr int LINE = 64 / sizeof(T);
  const RowGroup next = rows_from(rows.first + LANES, count);
  const T* first = array + next.first * stride;
  for (int k = 0; k < next.count * stride; k += LINE) __builtin_prefetch(first + k, WRITTEN);
}

/// The coefficients up to ``degree`` of the rows in ``wanted``.
template <bool RAGGED, typename T>
GSFW_FUNCTION void load_sh(const SplatArrays<T>& splats, const RowGroup& rows, uint32_t wanted,
                           int degree, ShCoefficients<T>& to) {
  const int numbers = 3 * num_coefficients(degree);
  if (!RAGGED && !splats.rest) {
    const auto colors = even_rows(splats.colors, splats.color_stride, rows);
    load_fields(colors, wanted, 0, numbers, to.field);
    return;
  }
  if (!RAGGED) ask_for_next<false>(splats.rest, splats.count, splats.rest_stride, rows);
  const auto rest = rest_rows<RAGGED>(splats, splats.rest, rows);
  load_fields(rest, wanted, 0, numbers - 3, to.field + 3);
  load_rows<3>(splats.colors + rows.first * 3, rows.count, to.field);
}

/// Sums of coefficient times basis: the colours before their clamp.
template <typename T>
GSFW_FUNCTION void sum_sh(int degree, const ShCoefficients<T>& coefficients, const Pack<T>* basis,
                          Pack<T>* sums) {
  for (int c = 0; c < 3; ++c) sums[c] = basis[0] * coefficients.field[c];
  for (int k = 1; k < num_coefficients(degree); ++k) {
    for (int c = 0; c < 3; ++c) {
      sums[c] = fma(basis[k], coefficients.field[3 * k + c], sums[c]);
    }
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
