// Projection: from a Gaussian in the scene to an ellipse in the image, and its gradient.
//
// ``Shape`` is Axes<T> or, for the form by covariance, Symmetric3<T>. The gradient recomputes what
// it needs from the inputs. For splats that are not visible results and gradients may be anything,
// NaN included: select what is visible, never multiply by 0.
#pragma once

#include "camera.h"
#include "ellipse.h"
#include "lens.h"
#include "splat_fields.h"

namespace gsfw {
namespace GSFW_ISA {

/// A projected Gaussian.
template <class T>
struct Projection {
  /// In pixels.
  Vector2<T> mean;
  /// Along the viewing axis, in scene units.
  T depth;
  /// Dilated, in pixels squared.
  Symmetric2<T> covariance;
  /// Determinant of the dilated covariance.
  T determinant;
  /// Compensated for the dilation where antialiasing is on.
  T opacity;
};

/// Gradient of the loss with respect to a projected Gaussian.
template <class T>
struct ProjectionGradient {
  /// dL/d mean, per pixel.
  Vector2<T> mean;
  /// dL/d depth.
  T depth;
  /// The second moments (falloff.h, for u and v of unit variance), which hold dL/d covariance. They
  /// are taken rather than that matrix because its entries cancel for needles.
  Symmetric2<T> second;
  /// dL/d opacity, the compensated one.
  T opacity;
};

/// The gradient of a Gaussian in the scene.
template <class T, class Shape>
struct GaussianGradient {
  Vector3<T> mean;
  Shape shape;
  /// Gradient of the opacity before its compensation.
  T opacity;
  /// This splat's share; a caller that does not read it does not pay for it.
  PoseGradient<T> pose;
};

/// Project a Gaussian: mean in scene units, opacity in [0, 1].
template <class T, class Shape>
GSFW_FUNCTION Projection<T> project(const Vector3<T>& mean, const Shape& shape, const T& opacity,
                                    const Camera<T>& camera, const Settings<T>& settings) {
  const Vector3<T> point = to_camera(camera, mean);
  const Sight<T> sight = see(camera, point);
  const Outline<T> plain = outline(shape, sight.jacobian * camera.rotation, settings);
  const Dilated<T> dilated = dilate(plain, settings.dilation);
  T kept = opacity;
  if (settings.antialias) {
    kept = opacity *
           compensation(plain.determinant, dilated.determinant, settings.compensation_min);
  }
  return {sight.pixel, point.z, dilated.covariance, dilated.determinant, kept};
}

/// dL/d opacity before its compensation, and by way of that dL/d determinants into ``result``.
template <class T>
GSFW_FUNCTION T opacity_through_compensation_vjp(const Outline<T>& plain, const T& opacity,
                                                 const T& gradient, const Settings<T>& settings,
                                                 OutlineGradient<T>& result) {
  if (!settings.antialias) return gradient;
  const T after = dilate(plain, settings.dilation).determinant;
  compensation_vjp(plain.determinant, after, settings.compensation_min, opacity, gradient, result);
  return gradient * compensation(plain.determinant, after, settings.compensation_min);
}

/// The gradient of ``project`` by all of its inputs.
template <class T, class Shape>
GSFW_FUNCTION GaussianGradient<T, Shape> project_vjp(const Vector3<T>& mean, const Shape& shape,
                                                     const T& opacity, const Camera<T>& camera,
                                                     const Settings<T>& settings,
                                                     const ProjectionGradient<T>& gradient) {
  const Vector3<T> point = to_camera(camera, mean);
  const Sight<T> sight = see(camera, point);
  const Matrix2x3<T> image_from_world = sight.jacobian * camera.rotation;
  const Outline<T> plain = outline(shape, image_from_world, settings);
  OutlineGradient<T> by_outline{gradient.second, T(0.0), T(0.0)};
  const T by_opacity = opacity_through_compensation_vjp(plain, opacity, gradient.opacity, settings,
                                                        by_outline);
  const ShapeGradient<Shape, T> by_shape =
      outline_vjp(shape, image_from_world, settings, by_outline);
  const Matrix2x3<T> by_jacobian = times_transposed(by_shape.image_from_world, camera.rotation);
  Vector3<T> by_point = see_vjp(camera, point, Sight<T>{gradient.mean, by_jacobian});
  by_point.z = by_point.z + gradient.depth;
  return {by_point * camera.rotation,
          by_shape.shape,
          by_opacity,
          {outer(by_point, mean) + transposed_times(sight.jacobian, by_shape.image_from_world),
           by_point}};
}

/// Visible extent of an ellipse.
template <class T>
struct Extent {
  Mask<T> visible;
  /// Half the sides of the exact bounding box, in pixels.
  Vector2<T> half;
};

/// Whether a projected Gaussian can reach a pixel, and where.
///
/// ``log_visibility`` is ln(opacity / alpha_min) of the compensated opacity (any number where
/// has_alpha_min is false): the ellipse ends where opacity exp(-q) falls to alpha_min, at
/// 2 q = 2 log_visibility. Comparisons are written so that NaN and infinity fail them.
template <class T>
GSFW_FUNCTION Extent<T> visible_extent(const Projection<T>& splat, const T& log_visibility,
                                       const Camera<T>& camera, const Settings<T>& settings) {
  const T zero(0.0), steepest = maximum(maximum(camera.focal.x, camera.focal.y), T(1.0));
  Mask<T> visible = (splat.depth >= settings.near) & (splat.depth <= settings.far);
  visible = visible & (splat.determinant > zero) & is_finite(splat.determinant);
  visible = visible & (absolute(splat.mean.x) <= settings.length_max) &
            (absolute(splat.mean.y) <= settings.length_max);
  // How fast the Jacobian changes with depth must fit the type too, or its gradient is NaN.
  visible = visible & is_finite(steepest / (splat.depth * splat.depth));
  if (!settings.has_alpha_min) {
    const T half(0.5);
    return {visible, {half * camera.size.x, half * camera.size.y}};
  }
  const T reach = T(2.0) * maximum(zero, log_visibility);
  const Vector2<T> half{square_root(reach * splat.covariance.xx),
                        square_root(reach * splat.covariance.yy)};
  visible = visible & (splat.opacity >= settings.alpha_min);
  visible = visible & (splat.mean.x + half.x > zero) & (splat.mean.x - half.x < camera.size.x);
  visible = visible & (splat.mean.y + half.y > zero) & (splat.mean.y - half.y < camera.size.y);
  return {visible, half};
}

/// The fields of a projected splat that describe its ellipse, [SPLAT_CHANNELS] of them.
template <class T>
GSFW_FUNCTION void ellipse_fields(const Projection<T>& splat, const T& level,
                                  const T& log_visibility, const Extent<T>& extent, T* fields) {
  const Whitening<T> scaled = scale_for_binary(whiten(splat.covariance, splat.determinant));
  const T reach = T(2.0) * maximum(T(0.0), log_visibility);
  const Symmetric2<T>& c = splat.covariance;
  fields[SPLAT_X] = splat.mean.x;
  fields[SPLAT_Y] = splat.mean.y;
  fields[SPLAT_R] = scaled.r;
  fields[SPLAT_WK] = -(scaled.w * scaled.k);
  fields[SPLAT_W] = scaled.w;
  fields[SPLAT_LEVEL] = level;
  fields[SPLAT_TILT] = c.xy / c.yy;
  fields[SPLAT_TURN] = c.xy * square_root(reach / c.xx);
  fields[SPLAT_NARROW] = square_root(reach * (splat.determinant / c.yy));
  fields[SPLAT_HEIGHT] = extent.half.y;
  fields[SPLAT_WIDTH] = extent.half.x;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
