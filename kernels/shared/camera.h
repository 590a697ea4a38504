// One camera, as every splat of a render sees it.
#pragma once

#include "vector.h"

namespace gsfw {
namespace GSFW_ISA {

/// How a camera maps directions to pixels; numbered as the bindings pass it.
enum class CameraModel : int { pinhole = 0, orthographic = 1, fisheye = 2 };

/// Every field but the model may be the same in all lanes.
template <class T>
struct Camera {
  CameraModel model;
  /// World to camera; axes are OpenCV's (x right, y down, z forward).
  Matrix3<T> rotation;
  /// In scene units.
  Vector3<T> translation;
  /// In pixels; in pixels per scene unit if orthographic.
  Vector2<T> focal;
  /// In pixels; the centre of the first pixel is (0.5, 0.5).
  Vector2<T> principal;
  /// Width and height in pixels.
  Vector2<T> size;
  /// The pinhole's Jacobian is taken at slopes x/z and y/z no less and no more than these.
  Vector2<T> slope_low, slope_high;
};

/// Set the slope limits: ``margin`` (NumericsProfile.jacobian_margin) times the tangent of half the
/// field of view, beyond the edges of the image.
template <class T>
GSFW_FUNCTION void set_slope_limits(Camera<T>& camera, const T& margin) {
  const T half = margin * T(0.5);
  const Vector2<T> beyond{half * camera.size.x / camera.focal.x,
                          half * camera.size.y / camera.focal.y};
  camera.slope_low = {-camera.principal.x / camera.focal.x - beyond.x,
                      -camera.principal.y / camera.focal.y - beyond.y};
  camera.slope_high = {(camera.size.x - camera.principal.x) / camera.focal.x + beyond.x,
                       (camera.size.y - camera.principal.y) / camera.focal.y + beyond.y};
}

/// From scene to camera axes.
template <class T>
GSFW_FUNCTION Vector3<T> to_camera(const Camera<T>& camera, const Vector3<T>& point) {
  return camera.rotation * point + camera.translation;
}

/// Position of the camera, in scene units.
template <class T>
GSFW_FUNCTION Vector3<T> camera_center(const Camera<T>& camera) {
  return -(camera.translation * camera.rotation);
}

/// Gradient of a camera's pose.
template <class T>
struct PoseGradient {
  /// dL/d rotation, all nine entries free.
  Matrix3<T> rotation;
  /// dL/d translation.
  Vector3<T> translation;
};

/// From dL/d camera centre to the pose: the centre is -rotation^T translation.
template <class T>
GSFW_FUNCTION PoseGradient<T> camera_center_vjp(const Camera<T>& camera,
                                                const Vector3<T>& gradient) {
  return {outer(-camera.translation, gradient), -(camera.rotation * gradient)};
}

}  // namespace GSFW_ISA
}  // namespace gsfw
