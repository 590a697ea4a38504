// The shared mathematics behind plain C functions, for the tests: rows in, rows out.
//
// Every function exists for float, double and Pair; that one reads and writes doubles, of an even
// number of rows.
#include "rows.h"

namespace tests {

template <class T, class Shape>
void project_rows(int n, const double* camera_numbers, const double* settings_numbers,
                  const typename Number<T>::Element* splats, int columns,
                  typename Number<T>::Element* ellipses) {
  const Camera<T> camera = camera_of<T>(camera_numbers);
  const Settings<T> settings = settings_of<T>(settings_numbers);
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(splats, columns, row);
    const Vector3<T> mean = in.vector3();
    Shape shape;
    in.shape(shape);
    const Projection<T> splat = project(mean, shape, in.next(), camera, settings);
    T ratio = splat.opacity / settings.alpha_min;
    for (int i = 0; i < Number<T>::lanes; ++i) {
      Number<T>::lane(ratio, i) = __builtin_log(Number<T>::lane(ratio, i));
    }
    const Extent<T> extent = visible_extent(splat, ratio, camera, settings);
    Writer<T> out(ellipses, 11, row);
    out.put(splat.mean), out.put(splat.depth), out.put(splat.covariance);
    out.put(splat.determinant), out.put(splat.opacity);
    out.put(select(extent.visible, T(1.0), T(0.0))), out.put(extent.half);
  }
}

template <class T, class Shape>
void project_vjp_rows(int n, const double* camera_numbers, const double* settings_numbers,
                      const typename Number<T>::Element* splats, int columns,
                      const typename Number<T>::Element* gradients,
                      typename Number<T>::Element* results) {
  const Camera<T> camera = camera_of<T>(camera_numbers);
  const Settings<T> settings = settings_of<T>(settings_numbers);
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(splats, columns, row), of(gradients, 7, row);
    const Vector3<T> mean = in.vector3();
    Shape shape;
    in.shape(shape);
    const ProjectionGradient<T> gradient{of.vector2(), of.next(), of.symmetric2(), of.next()};
    const GaussianGradient<T, Shape> result =
        project_vjp(mean, shape, in.next(), camera, settings, gradient);
    Writer<T> out(results, columns + 12, row);
    out.put(result.mean), out.put(result.shape), out.put(result.opacity);
    out.put(result.pose.rotation), out.put(result.pose.translation);
  }
}

template <class T>
void see_rows(int n, const double* camera_numbers, const typename Number<T>::Element* points,
              const typename Number<T>::Element* gradients,
              typename Number<T>::Element* results) {
  const Camera<T> camera = camera_of<T>(camera_numbers);
  for (int row = 0; row < n; row += Number<T>::lanes) {
    const Vector3<T> point = Reader<T>(points, 3, row).vector3();
    Reader<T> of(gradients, 8, row);
    const Sight<T> gradient{of.vector2(), of.matrix2x3()};
    const Sight<T> sight = see(camera, point);
    Writer<T> out(results, 11, row);
    out.put(sight.pixel), out.put(sight.jacobian), out.put(see_vjp(camera, point, gradient));
  }
}

template <class T>
void rotate_rows(int n, double min_norm, const typename Number<T>::Element* quaternions,
                 const typename Number<T>::Element* gradients,
                 typename Number<T>::Element* results) {
  for (int row = 0; row < n; row += Number<T>::lanes) {
    const Quaternion<T> q = Reader<T>(quaternions, 4, row).quaternion();
    const Orientation<T> given = orientation(q, T(min_norm));
    Writer<T> out(results, 13, row);
    out.put(rotation_matrix(given.unit));
    out.put(rotation_vjp(given, Reader<T>(gradients, 9, row).matrix3()));
  }
}

/// Rows of mean, then one gradient per basis function; results: basis, then dL/d mean.
template <class T>
void harmonics_rows(int n, int degree, const double* center_numbers,
                    const typename Number<T>::Element* rows,
                    typename Number<T>::Element* results) {
  const int count = num_coefficients(degree);
  const Vector3<T> center{T(center_numbers[0]), T(center_numbers[1]), T(center_numbers[2])};
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(rows, 3 + count, row);
    const Vector3<T> mean = in.vector3();
    const Vector3<T> direction = view_direction(mean, center);
    T gradients[25], basis[25];
    for (int k = 0; k < count; ++k) gradients[k] = in.next();
    sh_basis(degree, direction, basis);
    Writer<T> out(results, count + 3, row);
    for (int k = 0; k < count; ++k) out.put(basis[k]);
    out.put(view_direction_vjp(mean, center, sh_basis_vjp(degree, direction, gradients)));
  }
}

/// Rows of sum and gradient; results: colour and dL/d sum.
template <class T>
void color_rows(int n, const typename Number<T>::Element* rows,
                typename Number<T>::Element* results) {
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(rows, 2, row);
    const T sum = in.next();
    Writer<T> out(results, 2, row);
    out.put(sh_color(sum)), out.put(sh_color_vjp(sum, in.next()));
  }
}

/// Rows of covariance, determinant, offset, log2 of opacity; results: the whitening scaled for
/// binary, and the exponent of alpha.
template <class T>
void falloff_rows(int n, const typename Number<T>::Element* rows,
                  typename Number<T>::Element* results) {
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(rows, 7, row);
    const Symmetric2<T> covariance = in.symmetric2();
    const Whitening<T> whitening = scale_for_binary(whiten(covariance, in.next()));
    const Vector2<T> scaled = whitened(whitening, in.vector2());
    Writer<T> out(results, 4, row);
    out.put(whitening.r), out.put(whitening.k), out.put(whitening.w);
    out.put(alpha_exponent(in.next(), scaled));
  }
}

/// Rows of covariance, determinant, opacity and the moments of u and v scaled for binary; results:
/// gradients of mean, covariance and opacity.
template <class T>
void moments_rows(int n, const typename Number<T>::Element* rows,
                  typename Number<T>::Element* results) {
  for (int row = 0; row < n; row += Number<T>::lanes) {
    Reader<T> in(rows, 11, row);
    const Symmetric2<T> covariance = in.symmetric2();
    const Whitening<T> whitening = whiten(covariance, in.next());
    const T opacity = in.next();
    const Moments<T> moments =
        unscale_from_binary(Moments<T>{in.next(), in.vector2(), in.symmetric2()});
    Writer<T> out(results, 6, row);
    out.put(mean_vjp(whitening, moments.first));
    out.put(covariance_vjp(whitening, moments.second));
    out.put(opacity_vjp(moments.n, opacity));
  }
}

/// Rows of dL/d camera centre; results: dL/d rotation and dL/d translation.
template <class T>
void center_rows(int n, const double* camera_numbers, const typename Number<T>::Element* gradients,
                 typename Number<T>::Element* results) {
  const Camera<T> camera = camera_of<T>(camera_numbers);
  for (int row = 0; row < n; row += Number<T>::lanes) {
    const PoseGradient<T> pose =
        camera_center_vjp(camera, Reader<T>(gradients, 3, row).vector3());
    Writer<T> out(results, 15, row);
    out.put(camera_center(camera)), out.put(pose.rotation), out.put(pose.translation);
  }
}

}  // namespace tests

#define EXPORT(suffix, T, E)                                                                      \
  extern "C" void project_axes_##suffix(int n, const double* c, const double* s, const E* in,     \
                                        E* out) {                                                 \
    tests::project_rows<tests::T, tests::Axes<tests::T>>(n, c, s, in, 11, out);                   \
  }                                                                                               \
  extern "C" void project_covariance_##suffix(int n, const double* c, const double* s,            \
                                              const E* in, E* out) {                              \
    tests::project_rows<tests::T, tests::Symmetric3<tests::T>>(n, c, s, in, 10, out);             \
  }                                                                                               \
  extern "C" void project_axes_vjp_##suffix(int n, const double* c, const double* s,              \
                                            const E* in, const E* g, E* out) {                    \
    tests::project_vjp_rows<tests::T, tests::Axes<tests::T>>(n, c, s, in, 11, g, out);            \
  }                                                                                               \
  extern "C" void project_covariance_vjp_##suffix(int n, const double* c, const double* s,        \
                                                  const E* in, const E* g, E* out) {              \
    tests::project_vjp_rows<tests::T, tests::Symmetric3<tests::T>>(n, c, s, in, 10, g, out);      \
  }                                                                                               \
  extern "C" void see_##suffix(int n, const double* c, const E* in, const E* g, E* out) {         \
    tests::see_rows<tests::T>(n, c, in, g, out);                                                  \
  }                                                                                               \
  extern "C" void rotate_##suffix(int n, double least, const E* in, const E* g, E* out) {         \
    tests::rotate_rows<tests::T>(n, least, in, g, out);                                           \
  }                                                                                               \
  extern "C" void harmonics_##suffix(int n, int degree, const double* center, const E* in,        \
                                     E* out) {                                                    \
    tests::harmonics_rows<tests::T>(n, degree, center, in, out);                                  \
  }                                                                                               \
  extern "C" void color_##suffix(int n, const E* in, E* out) {                                    \
    tests::color_rows<tests::T>(n, in, out);                                                      \
  }                                                                                               \
  extern "C" void falloff_##suffix(int n, const E* in, E* out) {                                  \
    tests::falloff_rows<tests::T>(n, in, out);                                                    \
  }                                                                                               \
  extern "C" void moments_##suffix(int n, const E* in, E* out) {                                  \
    tests::moments_rows<tests::T>(n, in, out);                                                    \
  }                                                                                               \
  extern "C" void center_##suffix(int n, const double* c, const E* g, E* out) {                   \
    tests::center_rows<tests::T>(n, c, g, out);                                                   \
  }

namespace tests {
using Float = float;
using Double = double;
}  // namespace tests
EXPORT(float, Float, float)
EXPORT(double, Double, double)
EXPORT(pair, Pair, double)
