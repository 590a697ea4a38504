// Lens: where a camera model puts a point, how the image moves with it, and the gradient of both.
//
// The Jacobian is that of EWA splatting (Zwicker et al. 2001, equation 29) for the pinhole; the
// other two models follow from differentiating their own mapping. Points behind the camera give
// numbers without meaning, NaN included, which the tests for visibility refuse.
#pragma once

#include "camera.h"

namespace gsfw {
namespace GSFW_ISA {

/// Squared slope under which the fisheye's ratios are summed as series instead of divided. The
/// reference divides from 1e-2 on, which costs float32 three to four digits of the bend's
/// derivative.
constexpr double series_below = 0.1;

/// Terms of these series; the first one left out is series_below ** 16, about double rounding.
constexpr int series_terms = 16;

/// A point in the image.
template <class T>
struct Sight {
  /// In pixels.
  Vector2<T> pixel;
  /// d pixel / d point in camera axes.
  Matrix2x3<T> jacobian;
};

/// The fisheye r = theta at unit focal length, as functions of the squared slope s.
template <class T>
struct Equidistant {
  /// theta / tan(theta), which scales the slopes: atan(sqrt(s)) / sqrt(s).
  T ratio;
  /// Twice the derivative of ``ratio`` by s: (1 / (1 + s) - ratio) / s.
  T bend;
  /// The derivative of ``bend`` by s: -(1 / (1 + s)^2 + 3/2 bend) / s.
  T bend_slope;
};

/// The series, from ``Term`` on; ``minus`` is -s.
template <int Term, class T>
GSFW_FUNCTION Equidistant<T> equidistant_series(const T& minus) {
  if constexpr (Term == series_terms) {
    return {T(0.0), T(0.0), T(0.0)};
  } else {
    constexpr double n = Term;
    const Equidistant<T> rest = equidistant_series<Term + 1>(minus);
    return {fma(minus, rest.ratio, T(1 / (2 * n + 1))),
            fma(minus, rest.bend, T(-(2 * n + 2) / (2 * n + 3))),
            fma(minus, rest.bend_slope, T((n + 1) * (2 * n + 4) / (2 * n + 5)))};
  }
}

template <class T>
GSFW_FUNCTION Equidistant<T> equidistant(const T& squared) {
  const Mask<T> near_axis = squared < T(series_below);
  const T large = select(near_axis, T(1.0), squared);
  const Equidistant<T> series =
      equidistant_series<0>(select(near_axis, -squared, T(0.0)));
  const T root = square_root(large), inverse = T(1.0) / (T(1.0) + large);
  const T far_ratio = arc_tangent(root) / root;
  const T far_bend = (inverse - far_ratio) / large;
  const T far_slope = -fma(inverse, inverse, T(1.5) * far_bend) / large;
  return {select(near_axis, series.ratio, far_ratio), select(near_axis, series.bend, far_bend),
          select(near_axis, series.bend_slope, far_slope)};
}

template <class T>
GSFW_FUNCTION Sight<T> see_pinhole(const Camera<T>& camera, const Vector3<T>& point) {
  const Vector2<T> slope{point.x / point.z, point.y / point.z};
  // Linearised far outside the image, a splat would smear across it.
  const T limited_x = clamp(slope.x, camera.slope_low.x, camera.slope_high.x);
  const T limited_y = clamp(slope.y, camera.slope_low.y, camera.slope_high.y);
  const T depth = T(1.0) / point.z;
  const T scale_x = camera.focal.x * depth, scale_y = camera.focal.y * depth;
  const T zero(0.0);
  return {{fma(camera.focal.x, slope.x, camera.principal.x),
           fma(camera.focal.y, slope.y, camera.principal.y)},
          {{scale_x, zero, -(scale_x * limited_x)}, {zero, scale_y, -(scale_y * limited_y)}}};
}

template <class T>
GSFW_FUNCTION Sight<T> see_orthographic(const Camera<T>& camera, const Vector3<T>& point) {
  const T zero(0.0);
  return {{fma(camera.focal.x, point.x, camera.principal.x),
           fma(camera.focal.y, point.y, camera.principal.y)},
          {{camera.focal.x, zero, zero}, {zero, camera.focal.y, zero}}};
}

template <class T>
GSFW_FUNCTION Sight<T> see_fisheye(const Camera<T>& camera, const Vector3<T>& point) {
  const Vector2<T> slope{point.x / point.z, point.y / point.z};
  const T squared = dot(slope, slope);
  const Equidistant<T> lens = equidistant(squared);
  const T inverse = T(1.0) / (T(1.0) + squared);
  const T mixed = lens.bend * (slope.x * slope.y);
  const T depth = T(1.0) / point.z;
  const T scale_x = camera.focal.x * depth, scale_y = camera.focal.y * depth;
  return {{fma(camera.focal.x, slope.x * lens.ratio, camera.principal.x),
           fma(camera.focal.y, slope.y * lens.ratio, camera.principal.y)},
          {{scale_x * fma(lens.bend, slope.x * slope.x, lens.ratio), scale_x * mixed,
            -(scale_x * slope.x * inverse)},
           {scale_y * mixed, scale_y * fma(lens.bend, slope.y * slope.y, lens.ratio),
            -(scale_y * slope.y * inverse)}}};
}

/// Project a point of positive depth, given in camera axes.
template <class T>
GSFW_FUNCTION Sight<T> see(const Camera<T>& camera, const Vector3<T>& point) {
  if (camera.model == CameraModel::orthographic) return see_orthographic(camera, point);
  if (camera.model == CameraModel::fisheye) return see_fisheye(camera, point);
  return see_pinhole(camera, point);
}

/// With s = x/z, pixel = f s + c and the Jacobian's row is f/z (1, -clamp(s)).
template <class T>
GSFW_FUNCTION Vector3<T> see_pinhole_vjp(const Camera<T>& camera, const Vector3<T>& point,
                                         const Sight<T>& gradient) {
  const T inverse = T(1.0) / point.z;
  const Vector2<T> slope{point.x * inverse, point.y * inverse};
  const T limited_x = clamp(slope.x, camera.slope_low.x, camera.slope_high.x);
  const T limited_y = clamp(slope.y, camera.slope_low.y, camera.slope_high.y);
  const T scale_x = camera.focal.x * inverse, scale_y = camera.focal.y * inverse;
  const Matrix2x3<T>& by_jacobian = gradient.jacobian;
  const T free_x = select(within(slope.x, camera.slope_low.x, camera.slope_high.x),
                          scale_x * by_jacobian.x.z, T(0.0));
  const T free_y = select(within(slope.y, camera.slope_low.y, camera.slope_high.y),
                          scale_y * by_jacobian.y.z, T(0.0));
  const Vector2<T> by_slope{fma(camera.focal.x, gradient.pixel.x, -free_x),
                            fma(camera.focal.y, gradient.pixel.y, -free_y)};
  const T by_scale = fma(scale_x, fma(-limited_x, by_jacobian.x.z, by_jacobian.x.x),
                         scale_y * fma(-limited_y, by_jacobian.y.z, by_jacobian.y.y));
  return {by_slope.x * inverse, by_slope.y * inverse, -(dot(slope, by_slope) + by_scale) * inverse};
}

/// With U = (ratio I + bend s s^T, -s / (1 + |s|^2)) the Jacobian is f/z U, and the pixel f ratio
/// s.
template <class T>
GSFW_FUNCTION Vector3<T> see_fisheye_vjp(const Camera<T>& camera, const Vector3<T>& point,
                                         const Sight<T>& gradient) {
  const T depth = T(1.0) / point.z;
  const Vector2<T> slope{point.x * depth, point.y * depth};
  const T squared = dot(slope, slope);
  const Equidistant<T> lens = equidistant(squared);
  const T inverse = T(1.0) / (T(1.0) + squared);
  const Vector2<T> by_unit{camera.focal.x * gradient.pixel.x, camera.focal.y * gradient.pixel.y};
  const Vector3<T> first = (camera.focal.x * depth) * gradient.jacobian.x;   // dL/dU.
  const Vector3<T> second = (camera.focal.y * depth) * gradient.jacobian.y;

  const T mixed = first.y + second.x;
  const Vector2<T> turned{fma(T(2.0) * first.x, slope.x, mixed * slope.y),
                          fma(mixed, slope.x, T(2.0) * second.y * slope.y)};
  const T by_bend = T(0.5) * dot(slope, turned);
  const T by_ratio = dot(by_unit, slope) + first.x + second.y;
  const T along = fma(first.z, slope.x, second.z * slope.y) * inverse;
  const T by_squared =
      fma(T(0.5) * lens.bend, by_ratio, fma(lens.bend_slope, by_bend, along * inverse));
  const T twice = T(2.0) * by_squared;
  const Vector2<T> by_slope{
      fma(lens.ratio, by_unit.x,
          fma(lens.bend, turned.x, fma(twice, slope.x, -(first.z * inverse)))),
      fma(lens.ratio, by_unit.y,
          fma(lens.bend, turned.y, fma(twice, slope.y, -(second.z * inverse))))};
  // What remains is the factor 1/z of the Jacobian, whose gradient is <dL/dU, U>.
  const T by_scale = fma(lens.ratio, first.x + second.y, fma(lens.bend, by_bend, -along));
  return {by_slope.x * depth, by_slope.y * depth, -(dot(slope, by_slope) + by_scale) * depth};
}

/// dL/d point, in camera axes, from dL/d pixel and dL/d Jacobian.
template <class T>
GSFW_FUNCTION Vector3<T> see_vjp(const Camera<T>& camera, const Vector3<T>& point,
                                 const Sight<T>& gradient) {
  if (camera.model == CameraModel::orthographic) {
    return {camera.focal.x * gradient.pixel.x, camera.focal.y * gradient.pixel.y, T(0.0)};
  }
  if (camera.model == CameraModel::fisheye) return see_fisheye_vjp(camera, point, gradient);
  return see_pinhole_vjp(camera, point, gradient);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
