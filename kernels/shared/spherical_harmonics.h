// Real spherical harmonics up to degree 4, in the sign convention of 3DGS, and their gradient.
//
// Kerbl et al. 2023; the basis is that of Sloan, "Efficient Spherical Harmonic Evaluation", 2013,
// with the Condon-Shortley signs kept: band 1 is (-y, z, -x). The degree is the same for all lanes;
// where it is a constant of the caller, the branches on it vanish.
#pragma once

#include "vector.h"

namespace gsfw {
namespace GSFW_ISA {

/// 1 / (2 sqrt(pi)): the constant band.
constexpr double constant_band = 0.28209479177387814;

/// Shorter offsets than this are divided by it instead of by their length, as torch's normalize
/// does.
constexpr double direction_min_norm = 1e-12;

/// Number of coefficients of degrees 0 to ``degree`` together.
GSFW_FUNCTION constexpr int num_coefficients(int degree) { return (degree + 1) * (degree + 1); }

/// From the camera centre to the mean, of length 1 (or less, if they all but coincide).
template <class T>
GSFW_FUNCTION Vector3<T> view_direction(const Vector3<T>& mean, const Vector3<T>& center) {
  const Vector3<T> offset = mean - center;
  const T norm = maximum(T(direction_min_norm), square_root(dot(offset, offset)));
  return {offset.x / norm, offset.y / norm, offset.z / norm};
}

/// dL/d mean from dL/d direction; dL/d centre is the negative of it.
template <class T>
GSFW_FUNCTION Vector3<T> view_direction_vjp(const Vector3<T>& mean, const Vector3<T>& center,
                                            const Vector3<T>& gradient) {
  const Vector3<T> offset = mean - center;
  const T length = square_root(dot(offset, offset));
  const T inverse = T(1.0) / maximum(T(direction_min_norm), length);
  const Vector3<T> unit = inverse * offset;
  const T along = select(length >= T(direction_min_norm), dot(unit, gradient), T(0.0));
  return inverse * fma(-along, unit, gradient);
}

/// Coefficients 4 to 8.
template <class T>
GSFW_FUNCTION void band_2(const Vector3<T>& d, T* basis) {
  const T x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  basis[0] = T(1.0925484305920792) * (x * y);
  basis[1] = T(-1.0925484305920792) * (y * z);
  basis[2] = T(0.31539156525252005) * (T(2.0) * zz - xx - yy);
  basis[3] = T(-1.0925484305920792) * (x * z);
  basis[4] = T(0.5462742152960396) * (xx - yy);
}

/// Coefficients 9 to 15.
template <class T>
GSFW_FUNCTION void band_3(const Vector3<T>& d, T* basis) {
  const T x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  const T ring = T(4.0) * zz - xx - yy, three(3.0);
  basis[0] = T(-0.5900435899266435) * y * (three * xx - yy);
  basis[1] = T(2.890611442640554) * (x * y) * z;
  basis[2] = T(-0.4570457994644658) * y * ring;
  basis[3] = T(0.3731763325901154) * z * (T(2.0) * zz - three * xx - three * yy);
  basis[4] = T(-0.4570457994644658) * x * ring;
  basis[5] = T(1.445305721320277) * z * (xx - yy);
  basis[6] = T(-0.5900435899266435) * x * (xx - three * yy);
}

/// Coefficients 16 to 24.
template <class T>
GSFW_FUNCTION void band_4(const Vector3<T>& d, T* basis) {
  const T x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  const T seven = T(7.0) * zz - T(1.0), ring = T(7.0) * zz - T(3.0);
  const T first = xx - T(3.0) * yy, second = T(3.0) * xx - yy;
  basis[0] = T(2.5033429417967046) * (x * y) * (xx - yy);
  basis[1] = T(-1.7701307697799304) * (y * z) * second;
  basis[2] = T(0.9461746957575601) * (x * y) * seven;
  basis[3] = T(-0.6690465435572892) * (y * z) * ring;
  basis[4] = T(0.10578554691520431) * fma(zz, fma(T(35.0), zz, T(-30.0)), T(3.0));
  basis[5] = T(-0.6690465435572892) * (x * z) * ring;
  basis[6] = T(0.47308734787878004) * (xx - yy) * seven;
  basis[7] = T(-1.7701307697799304) * (x * z) * first;
  basis[8] = T(0.6258357354491761) * (xx * first - yy * second);
}

/// The basis functions in a unit direction, into ``num_coefficients(degree)`` numbers.
template <class T>
GSFW_FUNCTION void sh_basis(int degree, const Vector3<T>& direction, T* basis) {
  basis[0] = T(constant_band);
  if (degree >= 1) {
    basis[1] = T(-0.4886025119029199) * direction.y;
    basis[2] = T(0.4886025119029199) * direction.z;
    basis[3] = T(-0.4886025119029199) * direction.x;
  }
  if (degree >= 2) band_2(direction, basis + 4);
  if (degree >= 3) band_3(direction, basis + 9);
  if (degree >= 4) band_4(direction, basis + 16);
}

/// Derivative of band 2 by direction, weighted with its five ``g``.
template <class T>
GSFW_FUNCTION Vector3<T> band_2_vjp(const Vector3<T>& d, const T* g) {
  const T x = d.x, y = d.y, z = d.z;
  const T xy = T(1.0925484305920792) * g[0], yz = T(-1.0925484305920792) * g[1];
  const T xz = T(-1.0925484305920792) * g[3];
  const T polar = T(2 * 0.31539156525252005) * g[2], cross = T(2 * 0.5462742152960396) * g[4];
  return {fma(xy, y, fma(xz, z, (cross - polar) * x)),
          fma(xy, x, fma(yz, z, -(cross + polar) * y)),
          fma(yz, y, fma(xz, x, T(2.0) * polar * z))};
}

/// Derivative of band 3 by direction, weighted with its seven ``g``.
template <class T>
GSFW_FUNCTION Vector3<T> band_3_vjp(const Vector3<T>& d, const T* g) {
  const T x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  const T xy = x * y, xz = x * z, yz = y * z, three(3.0), six(6.0), two(2.0), eight(8.0);
  const T a = T(-0.5900435899266435) * g[0], b = T(2.890611442640554) * g[1];
  const T c = T(-0.4570457994644658) * g[2], e = T(0.3731763325901154) * g[3];
  const T f = T(-0.4570457994644658) * g[4], h = T(1.445305721320277) * g[5];
  const T i = T(-0.5900435899266435) * g[6], steep = T(4.0) * zz, saddle = three * (xx - yy);
  return {six * a * xy + b * yz - two * c * xy - six * e * xz + f * (steep - three * xx - yy) +
              two * h * xz + i * saddle,
          a * saddle + b * xz + c * (steep - xx - three * yy) - six * e * yz - two * f * xy -
              two * h * yz - six * i * xy,
          b * xy + eight * c * yz + three * e * (two * zz - xx - yy) + eight * f * xz +
              h * (xx - yy)};
}

/// Derivative of band 4 by direction, weighted with its nine ``g``.
template <class T>
GSFW_FUNCTION Vector3<T> band_4_vjp(const Vector3<T>& d, const T* g) {
  const T x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z, xyz = x * y * z;
  const T seven = T(7.0) * zz - T(1.0), ring = T(7.0) * zz - T(3.0), steep = T(21.0) * zz - T(3.0);
  const T first = xx - T(3.0) * yy, second = T(3.0) * xx - yy, saddle = T(3.0) * (xx - yy);
  const T two(2.0), four(4.0), six(6.0), fourteen(14.0);
  const T a = T(2.5033429417967046) * g[0], b = T(-1.7701307697799304) * g[1];
  const T c = T(0.9461746957575601) * g[2], e = T(-0.6690465435572892) * g[3];
  const T f = T(0.10578554691520431) * g[4], h = T(-0.6690465435572892) * g[5];
  const T i = T(0.47308734787878004) * g[6], j = T(-1.7701307697799304) * g[7];
  const T k = T(0.6258357354491761) * g[8];
  return {a * y * second + six * b * xyz + c * y * seven + h * z * ring + two * i * x * seven +
              j * z * saddle + four * k * x * first,
          a * x * first + b * z * saddle + c * x * seven + e * z * ring - two * i * y * seven -
              six * j * xyz - four * k * y * second,
          b * y * second + fourteen * c * xyz + e * y * steep +
              f * z * fma(T(140.0), zz, T(-60.0)) + h * x * steep + fourteen * i * z * (xx - yy) +
              j * x * first};
}

/// dL/d direction from dL/d basis, ``num_coefficients(degree)`` numbers.
template <class T>
GSFW_FUNCTION Vector3<T> sh_basis_vjp(int degree, const Vector3<T>& direction, const T* gradient) {
  Vector3<T> sum{T(0.0), T(0.0), T(0.0)};
  if (degree >= 1) {
    const T band(0.4886025119029199);
    sum = {-(band * gradient[3]), -(band * gradient[1]), band * gradient[2]};
  }
  if (degree >= 2) sum = sum + band_2_vjp(direction, gradient + 4);
  if (degree >= 3) sum = sum + band_3_vjp(direction, gradient + 9);
  if (degree >= 4) sum = sum + band_4_vjp(direction, gradient + 16);
  return sum;
}

/// A colour from the sum of coefficient times basis: max(0, 0.5 + sum).
template <class T>
GSFW_FUNCTION T sh_color(const T& sum) {
  return maximum(T(0.0), sum + T(0.5));
}

/// dL/d sum from dL/d colour. That of a coefficient is its basis function times this, that of the
/// basis the sum over the colours of coefficient times this.
template <class T>
GSFW_FUNCTION T sh_color_vjp(const T& sum, const T& gradient) {
  return select(sum + T(0.5) >= T(0.0), gradient, T(0.0));
}

}  // namespace GSFW_ISA
}  // namespace gsfw
