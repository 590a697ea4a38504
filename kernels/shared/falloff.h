// Falloff: a Gaussian in the image in whitened form, and what its pixels' gradients add up to.
//
// With Sigma2 = [[xx, xy], [xy, yy]] the dilated covariance, d = pixel - mean and
//     r = 1 / sqrt(xx),  k = xy / xx,  w = sqrt(xx / det),  L^-1 = [[r, 0], [-w k, w]],
// z = (u, v) = L^-1 d has unit variance: L L^T = Sigma2, and alpha = o exp(-|z|^2 / 2). This q
// cannot be negative, and needles keep the digits that A x^2 + 2 B x y + C y^2 cancels.
//
// Let g = alpha dL/dalpha = dL/d ln(alpha) at a pixel (0 where a cut-off has the say). Since
//     ln(alpha) = ln(o) - 1/2 d^T Sigma2^-1 d,   Sigma2^-1 d = L^-T z,
//     d ln(alpha) / d mean   = L^-T z,
//     d ln(alpha) / d Sigma2 = 1/2 (L^-T z) (L^-T z)^T  (all four entries free),
//     d ln(alpha) / d o      = 1 / o,
// a splat needs only six sums over its pixels, the moments n = sum g, first = sum g z and
// second = sum g z z^T:
//     dL/d mean = L^-T first,  dL/dSigma2 = 1/2 L^-T second L^-1,  dL/do = n / o.
#pragma once

#include "vector.h"

namespace gsfw {
namespace GSFW_ISA {

/// sqrt(log2(e) / 2): times this, u and v give the falloff as a power of two, 2^-(u^2 + v^2).
constexpr double binary_scale = 0.84932180028801904;

/// L^-1 = [[r, 0], [-w k, w]]; in 1 / pixels, k without a unit.
template <class T>
struct Whitening {
  T r, k, w;
};

/// The sums over pixels that a splat's gradient consists of.
template <class T>
struct Moments {
  /// sum g.
  T n;
  /// sum g u, sum g v.
  Vector2<T> first;
  /// sum g u u, sum g u v, sum g v v.
  Symmetric2<T> second;
};

/// The whitening of a dilated covariance (pixels squared) whose determinant is known better than
/// its entries would tell.
template <class T>
GSFW_FUNCTION Whitening<T> whiten(const Symmetric2<T>& covariance, const T& determinant) {
  return {T(1.0) / square_root(covariance.xx), covariance.xy / covariance.xx,
          square_root(covariance.xx / determinant)};
}

/// The same for u and v that are ``binary_scale`` times as large.
template <class T>
GSFW_FUNCTION Whitening<T> scale_for_binary(const Whitening<T>& whitening) {
  return {T(binary_scale) * whitening.r, whitening.k, T(binary_scale) * whitening.w};
}

/// u and v at an offset (pixels) from the mean.
template <class T>
GSFW_FUNCTION Vector2<T> whitened(const Whitening<T>& whitening, const Vector2<T>& offset) {
  return {whitening.r * offset.x, whitening.w * fma(-whitening.k, offset.x, offset.y)};
}

/// log2(opacity) - u^2 - v^2 for ``u`` and ``v`` scaled for binary: alpha, before its cut-offs, is
/// 2 to this power.
template <class T>
GSFW_FUNCTION T alpha_exponent(const T& log2_opacity, const Vector2<T>& scaled) {
  return fma(-scaled.x, scaled.x, fma(-scaled.y, scaled.y, log2_opacity));
}

/// Moments in u and v of unit variance from those in u and v scaled for binary.
template <class T>
GSFW_FUNCTION Moments<T> unscale_from_binary(const Moments<T>& moments) {
  const T once(1.0 / binary_scale), twice(1.0 / (binary_scale * binary_scale));
  return {moments.n,
          once * moments.first,
          {twice * moments.second.xx, twice * moments.second.xy, twice * moments.second.yy}};
}

/// dL/d mean (per pixel) from the first moments: L^-T first.
template <class T>
GSFW_FUNCTION Vector2<T> mean_vjp(const Whitening<T>& whitening, const Vector2<T>& first) {
  const T along = whitening.w * first.y;
  return {fma(whitening.r, first.x, -(whitening.k * along)), along};
}

/// dL/dSigma2 (per pixel squared) from the second moments: 1/2 L^-T second L^-1.
template <class T>
GSFW_FUNCTION Symmetric2<T> covariance_vjp(const Whitening<T>& whitening,
                                           const Symmetric2<T>& second) {
  const T r = whitening.r, w = whitening.w, wk = w * whitening.k;
  const T column = fma(r, second.xy, -(wk * second.yy));  // Upper right of L^-T second.
  const T half(0.5);
  return {half * fma(r, fma(r, second.xx, -(wk * second.xy)), -(wk * column)), half * (w * column),
          half * (w * w * second.yy)};
}

/// dL/d opacity from the sum of g; 0 for an opacity of 0, at which g says nothing.
template <class T>
GSFW_FUNCTION T opacity_vjp(const T& n, const T& opacity) {
  return select(opacity > T(0.0), n / opacity, T(0.0));
}

}  // namespace GSFW_ISA
}  // namespace gsfw
