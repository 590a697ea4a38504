// Rows of arrays as the fields of templates: what the test library reads and writes.
#pragma once

#include "pair.h"
#include "projection.h"
#include "spherical_harmonics.h"

namespace tests {

using namespace gsfw::GSFW_ISA;

/// What memory holds of a T, and how many rows a T holds at once.
template <class T>
struct Number {
  using Element = T;
  static constexpr int lanes = 1;
  static T& lane(T& value, int) { return value; }
};

template <>
struct Number<Pair> {
  using Element = double;
  static constexpr int lanes = 2;
  static double& lane(Pair& value, int i) { return i == 0 ? value.first : value.second; }
};

/// Walks over the columns of some rows, one row per lane.
template <class T>
class Reader {
 public:
  using Element = typename Number<T>::Element;
  Reader(const Element* rows, int columns, int row)
      : at_(rows + static_cast<long>(row) * columns), columns_(columns) {}

  T next() {
    T value(0.0);
    for (int i = 0; i < Number<T>::lanes; ++i) Number<T>::lane(value, i) = at_[i * columns_];
    ++at_;
    return value;
  }
  // Braces evaluate from left to right, as arguments do not.
  Vector2<T> vector2() { return Vector2<T>{next(), next()}; }
  Vector3<T> vector3() { return Vector3<T>{next(), next(), next()}; }
  Matrix2x3<T> matrix2x3() { return Matrix2x3<T>{vector3(), vector3()}; }
  Matrix3<T> matrix3() { return Matrix3<T>{vector3(), vector3(), vector3()}; }
  Symmetric2<T> symmetric2() { return Symmetric2<T>{next(), next(), next()}; }
  Quaternion<T> quaternion() { return Quaternion<T>{next(), next(), next(), next()}; }
  void shape(Axes<T>& axes) { axes = Axes<T>{quaternion(), vector3()}; }
  void shape(Symmetric3<T>& s) {
    s = Symmetric3<T>{next(), next(), next(), next(), next(), next()};
  }

 private:
  const Element* at_;
  int columns_;
};

/// The same for what comes out.
template <class T>
class Writer {
 public:
  using Element = typename Number<T>::Element;
  Writer(Element* rows, int columns, int row)
      : at_(rows + static_cast<long>(row) * columns), columns_(columns) {}

  void put(T value) {
    for (int i = 0; i < Number<T>::lanes; ++i) at_[i * columns_] = Number<T>::lane(value, i);
    ++at_;
  }
  void put(const Vector2<T>& v) { put(v.x), put(v.y); }
  void put(const Vector3<T>& v) { put(v.x), put(v.y), put(v.z); }
  void put(const Matrix2x3<T>& m) { put(m.x), put(m.y); }
  void put(const Matrix3<T>& m) { put(m.x), put(m.y), put(m.z); }
  void put(const Symmetric2<T>& s) { put(s.xx), put(s.xy), put(s.yy); }
  void put(const Symmetric3<T>& s) {
    put(s.xx), put(s.xy), put(s.xz), put(s.yy), put(s.yz), put(s.zz);
  }
  void put(const Quaternion<T>& q) { put(q.w), put(q.x), put(q.y), put(q.z); }
  void put(const Axes<T>& axes) { put(axes.rotation), put(axes.scales); }

 private:
  Element* at_;
  int columns_;
};

/// Model, rotation, translation, focal, principal, size and the margin of the slope limits.
template <class T>
Camera<T> camera_of(const double* c) {
  Camera<T> camera{};
  camera.model = static_cast<CameraModel>(static_cast<int>(c[0]));
  camera.rotation = {{T(c[1]), T(c[2]), T(c[3])},
                     {T(c[4]), T(c[5]), T(c[6])},
                     {T(c[7]), T(c[8]), T(c[9])}};
  camera.translation = {T(c[10]), T(c[11]), T(c[12])};
  camera.focal = {T(c[13]), T(c[14])};
  camera.principal = {T(c[15]), T(c[16])};
  camera.size = {T(c[17]), T(c[18])};
  set_slope_limits(camera, T(c[19]));
  return camera;
}

/// The fields of Settings in their order.
template <class T>
Settings<T> settings_of(const double* s) {
  return {T(s[0]), T(s[1]), T(s[2]), T(s[3]), T(s[4]), T(s[5]), T(s[6]), s[7] != 0, s[8] != 0};
}

}  // namespace tests
