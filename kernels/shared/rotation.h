// Rotations from quaternions of any norm, and back from gradients.
//
// The gradient goes by the torque: for R -> R exp([t]x) a loss changes by torque . t, and turning
// the unit quaternion q by t moves it by q (0, t / 2). Hence dL/dq = 2 q (0, torque) / |q|, which
// is orthogonal to q without being projected.
#pragma once

#include "vector.h"

namespace gsfw {
namespace GSFW_ISA {

/// Real part first.
template <class T>
struct Quaternion {
  T w, x, y, z;
};

/// A quaternion taken apart.
template <class T>
struct Orientation {
  /// Unit quaternion; the identity for one of length 0.
  Quaternion<T> unit;
  /// Norm of the given quaternion; 1 for one of length 0.
  T norm;
  /// True if the quaternion was too short to be a rotation.
  Mask<T> none;
};

/// The direction and the norm of a quaternion. One shorter than ``min_norm`` counts as the
/// identity.
template <class T>
GSFW_FUNCTION Orientation<T> orientation(const Quaternion<T>& q, const T& min_norm) {
  // Dividing by the largest component first keeps the squares of 1e20 within float32.
  const T largest = maximum(maximum(absolute(q.w), absolute(q.x)),
                            maximum(absolute(q.y), absolute(q.z)));
  const T safe = maximum(T(1e-30), largest), shrink = T(1.0) / safe;
  const Quaternion<T> p{shrink * q.w, shrink * q.x, shrink * q.y, shrink * q.z};
  const T length = square_root(fma(p.w, p.w, fma(p.x, p.x, fma(p.y, p.y, p.z * p.z))));
  const T norm = safe * length;
  const Mask<T> none = norm < min_norm;
  const T inverse = T(1.0) / select(none, T(1.0), length);
  return {{select(none, T(1.0), p.w * inverse), select(none, T(0.0), p.x * inverse),
           select(none, T(0.0), p.y * inverse), select(none, T(0.0), p.z * inverse)},
          select(none, T(1.0), norm),
          none};
}

/// The rotation matrix of a unit quaternion.
template <class T>
GSFW_FUNCTION Matrix3<T> rotation_matrix(const Quaternion<T>& unit) {
  const T w = unit.w, x = unit.x, y = unit.y, z = unit.z;
  const T one(1.0), two(2.0);
  return {{one - two * fma(y, y, z * z), two * fma(x, y, -(w * z)), two * fma(x, z, w * y)},
          {two * fma(x, y, w * z), one - two * fma(x, x, z * z), two * fma(y, z, -(w * x))},
          {two * fma(x, z, -(w * y)), two * fma(y, z, w * x), one - two * fma(x, x, y * y)}};
}

/// dL/dq of the quaternion given, from the torque; 0 where it was too short to be a rotation.
template <class T>
GSFW_FUNCTION Quaternion<T> torque_vjp(const Orientation<T>& given, const Vector3<T>& torque) {
  const Quaternion<T>& q = given.unit;
  const T factor = select(given.none, T(0.0), T(2.0) / given.norm);
  return {factor * -fma(q.x, torque.x, fma(q.y, torque.y, q.z * torque.z)),
          factor * fma(q.w, torque.x, difference_of_products(q.y, torque.z, q.z, torque.y)),
          factor * fma(q.w, torque.y, difference_of_products(q.z, torque.x, q.x, torque.z)),
          factor * fma(q.w, torque.z, difference_of_products(q.x, torque.y, q.y, torque.x))};
}

/// dL/dq from dL/dR: the torque is the sum of dL/d row x row.
template <class T>
GSFW_FUNCTION Quaternion<T> rotation_vjp(const Orientation<T>& given, const Matrix3<T>& gradient) {
  const Matrix3<T> r = rotation_matrix(given.unit);
  const Vector3<T> torque =
      cross(gradient.x, r.x) + cross(gradient.y, r.y) + cross(gradient.z, r.z);
  return torque_vjp(given, torque);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
