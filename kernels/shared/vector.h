// Vectors and small matrices of a number type T.
#pragma once

#include "number.h"

namespace gsfw {
namespace GSFW_ISA {

template <class T>
struct Vector2 {
  T x, y;
};

template <class T>
struct Vector3 {
  T x, y, z;
};

/// Two rows: what maps three dimensions to the image.
template <class T>
struct Matrix2x3 {
  Vector3<T> x, y;
};

/// Three rows.
template <class T>
struct Matrix3 {
  Vector3<T> x, y, z;
};

/// [[xx, xy], [xy, yy]]. As a gradient it is this full matrix too: ``xy`` is the derivative by ONE
/// of the two off-diagonal entries, half of that by the number they share.
template <class T>
struct Symmetric2 {
  T xx, xy, yy;
};

/// [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]; as a gradient, like ``Symmetric2``.
template <class T>
struct Symmetric3 {
  T xx, xy, xz, yy, yz, zz;
};

template <class T>
GSFW_FUNCTION Vector2<T> operator*(const T& factor, const Vector2<T>& v) {
  return {factor * v.x, factor * v.y};
}

template <class T>
GSFW_FUNCTION Vector3<T> operator*(const T& factor, const Vector3<T>& v) {
  return {factor * v.x, factor * v.y, factor * v.z};
}

template <class T>
GSFW_FUNCTION Vector3<T> operator+(const Vector3<T>& a, const Vector3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}

template <class T>
GSFW_FUNCTION Vector3<T> operator-(const Vector3<T>& a, const Vector3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

template <class T>
GSFW_FUNCTION Vector3<T> operator-(const Vector3<T>& v) {
  return {-v.x, -v.y, -v.z};
}

/// factor * v + added.
template <class T>
GSFW_FUNCTION Vector3<T> fma(const T& factor, const Vector3<T>& v, const Vector3<T>& added) {
  return {fma(factor, v.x, added.x), fma(factor, v.y, added.y), fma(factor, v.z, added.z)};
}

/// Component by component.
template <class T>
GSFW_FUNCTION Vector3<T> product(const Vector3<T>& a, const Vector3<T>& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}

template <class T>
GSFW_FUNCTION T dot(const Vector2<T>& a, const Vector2<T>& b) {
  return fma(a.x, b.x, a.y * b.y);
}

template <class T>
GSFW_FUNCTION T dot(const Vector3<T>& a, const Vector3<T>& b) {
  return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

/// The cross product, to full precision of its components even for nearly parallel vectors.
template <class T>
GSFW_FUNCTION Vector3<T> cross(const Vector3<T>& a, const Vector3<T>& b) {
  return {difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
          difference_of_products(a.x, b.y, a.y, b.x)};
}

template <class T>
GSFW_FUNCTION Vector3<T> operator*(const Matrix3<T>& m, const Vector3<T>& v) {
  return {dot(m.x, v), dot(m.y, v), dot(m.z, v)};
}

/// row M, which is M^T row.
template <class T>
GSFW_FUNCTION Vector3<T> operator*(const Vector3<T>& row, const Matrix3<T>& m) {
  return fma(row.x, m.x, fma(row.y, m.y, row.z * m.z));
}

template <class T>
GSFW_FUNCTION Vector3<T> operator*(const Symmetric3<T>& m, const Vector3<T>& v) {
  return {fma(m.xx, v.x, fma(m.xy, v.y, m.xz * v.z)), fma(m.xy, v.x, fma(m.yy, v.y, m.yz * v.z)),
          fma(m.xz, v.x, fma(m.yz, v.y, m.zz * v.z))};
}

template <class T>
GSFW_FUNCTION Matrix2x3<T> operator*(const Matrix2x3<T>& a, const Matrix3<T>& b) {
  return {a.x * b, a.y * b};
}

/// A B^T.
template <class T>
GSFW_FUNCTION Matrix2x3<T> times_transposed(const Matrix2x3<T>& a, const Matrix3<T>& b) {
  return {b * a.x, b * a.y};
}

/// S A, for a symmetric S.
template <class T>
GSFW_FUNCTION Matrix2x3<T> operator*(const Symmetric2<T>& s, const Matrix2x3<T>& a) {
  return {fma(s.xx, a.x, s.xy * a.y), fma(s.xy, a.x, s.yy * a.y)};
}

/// A^T B.
template <class T>
GSFW_FUNCTION Matrix3<T> transposed_times(const Matrix2x3<T>& a, const Matrix2x3<T>& b) {
  return {fma(a.x.x, b.x, a.y.x * b.y), fma(a.x.y, b.x, a.y.y * b.y),
          fma(a.x.z, b.x, a.y.z * b.y)};
}

/// A^T B where the caller knows it to be symmetric.
template <class T>
GSFW_FUNCTION Symmetric3<T> symmetric_product(const Matrix2x3<T>& a, const Matrix2x3<T>& b) {
  return {fma(a.x.x, b.x.x, a.y.x * b.y.x), fma(a.x.x, b.x.y, a.y.x * b.y.y),
          fma(a.x.x, b.x.z, a.y.x * b.y.z), fma(a.x.y, b.x.y, a.y.y * b.y.y),
          fma(a.x.y, b.x.z, a.y.y * b.y.z), fma(a.x.z, b.x.z, a.y.z * b.y.z)};
}

/// a b^T.
template <class T>
GSFW_FUNCTION Matrix3<T> outer(const Vector3<T>& a, const Vector3<T>& b) {
  return {a.x * b, a.y * b, a.z * b};
}

template <class T>
GSFW_FUNCTION Matrix3<T> operator+(const Matrix3<T>& a, const Matrix3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}

}  // namespace GSFW_ISA
}  // namespace gsfw
