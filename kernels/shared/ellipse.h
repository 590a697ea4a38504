// Ellipse: the shape of a Gaussian in the image, and the gradient of its two forms.
//
// Kerbl et al. 2023, section 4, equations 5 and 6; the compensation is Mip-Splatting's 2D filter
// (Yu et al. 2024, equation 9). With A = Jacobian rotation (2 x 3), the form by axes builds P = A R
// diag(s) and sums the determinant of P P^T as |n|^2, n = p1 x p2 (Lagrange's identity), where the
// original's a c - b^2 loses all digits for needles.
#pragma once

#include "falloff.h"
#include "rotation.h"
#include "settings.h"

namespace gsfw {
namespace GSFW_ISA {

/// A Gaussian's shape by its rotation and its standard deviations (scene units).
template <class T>
struct Axes {
  Quaternion<T> rotation;
  Vector3<T> scales;
};

/// A projected Gaussian before its dilation.
template <class T>
struct Outline {
  /// In pixels squared.
  Symmetric2<T> covariance;
  /// Determinant of the covariance, free of cancellation.
  T determinant;
};

/// Gradient of the loss with respect to an ellipse.
template <class T>
struct OutlineGradient {
  /// The second moments of the blended pixels, which hold dL/dSigma2 of the dilated covariance.
  Symmetric2<T> second;
  /// dL/d determinant before and after the dilation, by way of the compensation alone.
  T before, after;
};

/// A dilated outline.
template <class T>
struct Dilated {
  Symmetric2<T> covariance;
  T determinant;
};

template <class T>
GSFW_FUNCTION Dilated<T> dilate(const Outline<T>& plain, const T& dilation) {
  const Symmetric2<T>& c = plain.covariance;
  return {{c.xx + dilation, c.xy, c.yy + dilation},
          fma(dilation, c.xx + c.yy + dilation, plain.determinant)};
}

/// The form by axes while it is projected.
template <class T>
struct ProjectedAxes {
  /// Rotation of the axes, in the scene.
  Matrix3<T> rotation;
  /// Standard deviations, limited.
  Vector3<T> scales;
  /// A R: the image of the axes' directions.
  Matrix2x3<T> directions;
  /// P, not limited yet.
  Matrix2x3<T> free;
  /// P, limited; rows p1 and p2.
  Matrix2x3<T> axes;
  /// p1 x p2.
  Vector3<T> normal;
};

template <class T>
GSFW_FUNCTION Vector3<T> limited(const Vector3<T>& v, const T& most) {
  return {clamp(v.x, -most, most), clamp(v.y, -most, most), clamp(v.z, -most, most)};
}

template <class T>
GSFW_FUNCTION ProjectedAxes<T> project_axes(const Orientation<T>& given, const Vector3<T>& scales,
                                     const Matrix2x3<T>& image_from_world, const T& length_max) {
  ProjectedAxes<T> projected;
  projected.rotation = rotation_matrix(given.unit);
  projected.scales = {minimum(length_max, scales.x), minimum(length_max, scales.y),
                  minimum(length_max, scales.z)};
  projected.directions = image_from_world * projected.rotation;
  projected.free = {product(projected.directions.x, projected.scales),
                product(projected.directions.y, projected.scales)};
  projected.axes = {limited(projected.free.x, length_max), limited(projected.free.y, length_max)};
  projected.normal = cross(projected.axes.x, projected.axes.y);
  return projected;
}

template <class T>
GSFW_FUNCTION Outline<T> outline_of(const ProjectedAxes<T>& projected) {
  const Matrix2x3<T>& p = projected.axes;
  return {{dot(p.x, p.x), dot(p.x, p.y), dot(p.y, p.y)}, dot(projected.normal, projected.normal)};
}

/// P P^T from rotation and scales.
template <class T>
GSFW_FUNCTION Outline<T> outline(const Axes<T>& shape, const Matrix2x3<T>& image_from_world,
                                 const Settings<T>& settings) {
  return outline_of(project_axes(orientation(shape.rotation, settings.quaternion_min_norm),
                              shape.scales, image_from_world, settings.length_max));
}

/// A Sigma A^T while its entries are not limited yet.
template <class T>
GSFW_FUNCTION Symmetric2<T> project_covariance(const Symmetric3<T>& covariance,
                                               const Matrix2x3<T>& image_from_world) {
  const Vector3<T> first = covariance * image_from_world.x;
  const Vector3<T> second = covariance * image_from_world.y;
  return {dot(image_from_world.x, first), dot(image_from_world.y, first),
          dot(image_from_world.y, second)};
}

template <class T>
GSFW_FUNCTION Symmetric2<T> limited(const Symmetric2<T>& free, const T& most) {
  return {clamp(free.xx, T(0.0), most), clamp(free.xy, -most, most), clamp(free.yy, T(0.0), most)};
}

/// A Sigma A^T from a covariance (scene units squared; of a matrix that is not quite symmetric,
/// give the mean of its two off-diagonal entries). What rounding makes negative counts as 0.
template <class T>
GSFW_FUNCTION Outline<T> outline(const Symmetric3<T>& covariance,
                                 const Matrix2x3<T>& image_from_world,
                                 const Settings<T>& settings) {
  const T most = settings.length_max * settings.length_max;
  const Symmetric2<T> c = limited(project_covariance(covariance, image_from_world), most);
  return {c, maximum(T(0.0), difference_of_products(c.xx, c.yy, c.xy, c.xy))};
}

/// By how much the dilation would brighten a splat: sqrt(max(before / after, floor^2)) of the
/// determinants.
template <class T>
GSFW_FUNCTION T compensation(const T& before, const T& after, const T& floor) {
  return square_root(maximum(floor * floor, before / after));
}

/// dL/d determinants from dL/d(opacity * compensation), into ``before`` and ``after``.
template <class T>
GSFW_FUNCTION void compensation_vjp(const T& before, const T& after, const T& floor,
                                    const T& opacity, const T& gradient,
                                    OutlineGradient<T>& result) {
  const T ratio = before / after, lowest = floor * floor;
  const T kept = square_root(maximum(lowest, ratio));
  const T by_ratio = select(ratio >= lowest, T(0.5) * gradient * opacity / kept, T(0.0));
  result.before = by_ratio / after;
  result.after = -(ratio * result.before);
}

/// A shape's gradient, and that of the matrix A = image_from_world it was projected with.
template <class Shape, class T>
struct ShapeGradient {
  Shape shape;
  Matrix2x3<T> image_from_world;
};

/// dL/dP. The dilated ellipse has whitened axes Z = L^-1 P, so that 2 dL/dSigma2 P = L^-T second Z;
/// their second row w (p2 - k p1) is summed as w / xx (n x p1 + dilation p2), which does not
/// cancel.
template <class T>
GSFW_FUNCTION Matrix2x3<T> axes_vjp(const ProjectedAxes<T>& projected, const Outline<T>& plain,
                                    const Settings<T>& settings,
                                    const OutlineGradient<T>& gradient) {
  const Matrix2x3<T>& p = projected.axes;
  const Dilated<T> dilated = dilate(plain, settings.dilation);
  const Whitening<T> whitening = whiten(dilated.covariance, dilated.determinant);
  const Vector3<T> across = cross(projected.normal, p.x);
  const Matrix2x3<T> whitened{
      whitening.r * p.x,
      (whitening.w / dilated.covariance.xx) * fma(settings.dilation, p.y, across)};
  const Matrix2x3<T> pulled = gradient.second * whitened;
  const Vector3<T> along = whitening.w * pulled.y;
  Matrix2x3<T> by_axes{fma(-whitening.k, along, whitening.r * pulled.x), along};
  if (settings.antialias) {
    // d |n|^2 = 2 (p2 x n) dp1 + 2 (n x p1) dp2, and dilating adds dilation (|p1|^2 + |p2|^2).
    const T by_normal = T(2.0) * (gradient.before + gradient.after);
    const T by_length = T(2.0) * settings.dilation * gradient.after;
    by_axes.x = by_axes.x + fma(by_normal, cross(p.y, projected.normal), by_length * p.x);
    by_axes.y = by_axes.y + fma(by_normal, across, by_length * p.y);
  }
  return by_axes;
}

/// A gradient where the limit lets it through.
template <class T>
GSFW_FUNCTION Vector3<T> limited_vjp(const Vector3<T>& free, const Vector3<T>& gradient,
                                     const T& most) {
  const T zero(0.0);
  return {select(within(free.x, -most, most), gradient.x, zero),
          select(within(free.y, -most, most), gradient.y, zero),
          select(within(free.z, -most, most), gradient.z, zero)};
}

/// From an ellipse to rotation and scales; 0 where a limit is active.
template <class T>
GSFW_FUNCTION ShapeGradient<Axes<T>, T> outline_vjp(const Axes<T>& shape,
                                                    const Matrix2x3<T>& image_from_world,
                                                    const Settings<T>& settings,
                                                    const OutlineGradient<T>& gradient) {
  const T most = settings.length_max, zero(0.0);
  const Orientation<T> given = orientation(shape.rotation, settings.quaternion_min_norm);
  const ProjectedAxes<T> projected = project_axes(given, shape.scales, image_from_world, most);
  const Matrix2x3<T> limited_axes = axes_vjp(projected, outline_of(projected), settings, gradient);
  const Matrix2x3<T> by_axes{limited_vjp(projected.free.x, limited_axes.x, most),
                             limited_vjp(projected.free.y, limited_axes.y, most)};
  const Matrix2x3<T> by_directions{product(by_axes.x, projected.scales),
                                   product(by_axes.y, projected.scales)};
  const Vector3<T> by_scales =
      product(by_axes.x, projected.directions.x) + product(by_axes.y, projected.directions.y);
  // Turning the axes turns the rows of ``directions`` as it turns those of R.
  const Vector3<T> torque = cross(by_directions.x, projected.directions.x) +
                            cross(by_directions.y, projected.directions.y);
  return {{torque_vjp(given, torque),
           {select(shape.scales.x <= most, by_scales.x, zero),
            select(shape.scales.y <= most, by_scales.y, zero),
            select(shape.scales.z <= most, by_scales.z, zero)}},
          times_transposed(by_directions, projected.rotation)};
}

/// From an ellipse to a covariance: A^T G A with G = dL/dSigma2, whose off-diagonal entries are
/// each the derivative by one entry of the 3 x 3 matrix.
template <class T>
GSFW_FUNCTION ShapeGradient<Symmetric3<T>, T> outline_vjp(const Symmetric3<T>& covariance,
                                                          const Matrix2x3<T>& image_from_world,
                                                          const Settings<T>& settings,
                                                          const OutlineGradient<T>& gradient) {
  const T most = settings.length_max * settings.length_max, zero(0.0);
  const Symmetric2<T> free = project_covariance(covariance, image_from_world);
  const Symmetric2<T> c = limited(free, most);
  const T determinant = difference_of_products(c.xx, c.yy, c.xy, c.xy);
  const Dilated<T> dilated = dilate({c, maximum(zero, determinant)}, settings.dilation);
  const Whitening<T> whitening = whiten(dilated.covariance, dilated.determinant);
  // If rounding's negative determinant was raised to 0, that after the dilation depends on the
  // trace alone, and with it w, whose share is second.yy: d ln(w) = (d ln(xx) - d ln(det)) / 2.
  const Mask<T> raised = determinant < zero;
  Symmetric2<T> second = gradient.second;
  const T by_w = select(raised, T(0.5) * second.yy, zero);
  second.yy = select(raised, zero, second.yy);
  const T by_determinant = select(raised, zero, gradient.before + gradient.after);
  const T by_trace = settings.dilation * (gradient.after + by_w / dilated.determinant);
  Symmetric2<T> g = covariance_vjp(whitening, second);
  g = {fma(by_determinant, c.yy, g.xx + by_trace) - by_w / dilated.covariance.xx,
       fma(-by_determinant, c.xy, g.xy), fma(by_determinant, c.xx, g.yy + by_trace)};
  g = {select(within(free.xx, zero, most), g.xx, zero),
       select(within(free.xy, -most, most), g.xy, zero),
       select(within(free.yy, zero, most), g.yy, zero)};
  const Matrix2x3<T> pulled = g * image_from_world;
  const T two(2.0);
  return {symmetric_product(image_from_world, pulled),
          {two * (covariance * pulled.x), two * (covariance * pulled.y)}};
}

}  // namespace GSFW_ISA
}  // namespace gsfw
