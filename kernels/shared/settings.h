// The conventions of a render, as every splat of it meets them.
#pragma once

#include "number.h"

namespace gsfw {
namespace GSFW_ISA {

/// The numbers are core/numerics.py's, which alone defines them: bindings hand them over.
template <class T>
struct Settings {
  /// NumericsProfile.dilation, in pixels squared.
  T dilation;
  /// NumericsProfile.compensation_min.
  T compensation_min;
  /// NumericsProfile.alpha_min.
  T alpha_min;
  /// The larger of RenderSettings.near and DEPTH_MIN, in scene units.
  T near;
  /// RenderSettings.far, in scene units.
  T far;
  /// LENGTH_MAX, in scene units and in pixels.
  T length_max;
  /// QUATERNION_MIN_NORM.
  T quaternion_min_norm;
  /// RenderSettings.antialias: whether opacities are compensated for the dilation.
  bool antialias;
  /// Whether alpha_min is above 0; if not, every splat in front reaches the whole image.
  bool has_alpha_min;
};

}  // namespace GSFW_ISA
}  // namespace gsfw
