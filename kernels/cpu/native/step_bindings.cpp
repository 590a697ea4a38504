// The step besides rendering, as Python sees it: the caller's arrays, neither copied nor converted.
#include "bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <optional>
#include <stdexcept>

#include "step.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace gsfw {
namespace {

template <typename T>
using Images = nb::ndarray<T, nb::ndim<4>, nb::c_contig, nb::device::cpu>;
using Valid = nb::ndarray<const uint8_t, nb::ndim<4>, nb::c_contig, nb::device::cpu>;
/// Rows along the first of any number of axes.
template <typename T>
using Rows = nb::ndarray<T, nb::device::cpu>;
template <typename T>
using Table = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Numbers = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

void require(bool fits, const char* complaint) {
  if (!fits) throw std::invalid_argument(complaint);
}

template <typename A, typename B>
bool same_shape(const A& a, const B& b, size_t axes) {
  for (size_t axis = 0; axis < axes; ++axis) {
    if (a.shape(axis) != b.shape(axis)) return false;
  }
  return true;
}

template <typename T>
Comparison<T> comparison(const Images<const T>& rendered, const Images<const T>& target,
                         const std::optional<Valid>& valid) {
  require(same_shape(rendered, target, 4), "rendered and target are not of one shape");
  require(!valid || (same_shape(rendered, *valid, 3) && valid->shape(3) == 1),
          "valid does not fit the images");
  return {rendered.data(),
          target.data(),
          valid ? valid->data() : nullptr,
          int64_t(rendered.shape(0)),
          int64_t(rendered.shape(1)),
          int64_t(rendered.shape(2)),
          int64_t(rendered.shape(3))};
}

template <typename T>
std::pair<double, double> l1_dssim(const Images<const T>& rendered,
                                   const Images<const T>& target,
                                   const std::optional<Valid>& valid,
                                   const std::optional<Images<T>>& gradient, int threads) {
  const Comparison<T> images = comparison<T>(rendered, target, valid);
  require(!gradient || same_shape(rendered, *gradient, 4), "gradient does not fit the images");
  T* const to = gradient ? gradient->data() : nullptr;
  nb::gil_scoped_release unlocked;
  const Losses losses = l1_dissimilarity(images, to, threads);
  return {losses.l1, losses.dissimilarity};
}

template <typename T>
void l1_dssim_backward(const Images<const T>& rendered, const Images<const T>& target,
                       const std::optional<Valid>& valid, const Images<const T>& dssim_gradient,
                       double l1, double dssim, const Images<T>& gradient, int threads) {
  const Comparison<T> images = comparison<T>(rendered, target, valid);
  require(same_shape(rendered, dssim_gradient, 4) && same_shape(rendered, gradient, 4),
          "a gradient does not fit the images");
  const T* const from = dssim_gradient.data();
  T* const to = gradient.data();
  nb::gil_scoped_release unlocked;
  loss_gradient(images, from, l1, dssim, to, threads);
}

/// True if the numbers of each row lie next to one another, in order.
template <typename T>
bool rows_are_whole(const Rows<T>& rows) {
  int64_t numbers = 1;
  for (size_t axis = rows.ndim(); axis-- > 1;) {
    if (rows.shape(axis) != 1 && rows.stride(axis) != numbers) return false;
    numbers *= int64_t(rows.shape(axis));
  }
  return true;
}

template <typename T, typename U>
bool fits(const Rows<T>& rows, const Rows<U>& like) {
  return rows.ndim() == like.ndim() && same_shape(rows, like, like.ndim()) && rows_are_whole(rows);
}

template <typename T>
StridedRows<T> strided(const Rows<T>& rows) {
  return {rows.data(), rows.stride(0)};
}

template <typename T>
bool adam(const Rows<T>& values, const Rows<const T>& gradient, const Rows<T>& first,
          const Rows<T>& second, const std::optional<Indices>& rows, double beta1, double beta2,
          double bias2, double rate, double epsilon, double gradient_limit, int threads) {
  if (values.ndim() == 0 || values.size() == 0 || !rows_are_whole(values)) return false;
  if (!fits(gradient, values) || !fits(first, values) || !fits(second, values)) return false;
  const int64_t all = int64_t(values.shape(0)), width = int64_t(values.size()) / all;
  AdamJob<T> job = {strided<T>(values), strided<const T>(gradient), strided<T>(first),
                    strided<T>(second), width, rows ? rows->data() : nullptr,
                    T(1.0 - beta1), T(1) - T(1.0 - beta2), T(1.0 - beta2), T(bias2), T(rate),
                    T(epsilon), T(gradient_limit)};
  const int64_t count = rows ? int64_t(rows->shape(0)) : all;
  for (int64_t i = 0; rows && i < count; ++i) {
    require(job.rows[i] >= 0 && job.rows[i] < all, "there is no such row");
  }
  nb::gil_scoped_release unlocked;
  adam_step(job, count, threads);
  return true;
}

template <typename T>
bool is_all_finite(const Numbers<T>& numbers, int threads) {
  const T* const data = numbers.data();
  const int64_t count = int64_t(numbers.size());
  nb::gil_scoped_release unlocked;
  return all_finite(data, count, threads);
}

template <typename T>
void add_noise_to(const Table<T>& means, const Table<const T>& quats,
                  const Table<const T>& log_scales, const Numbers<T>& opacity_logits,
                  const Table<const T>& noise, double rate, double opacity, double sharpness,
                  int threads) {
  const size_t count = means.shape(0);
  require(means.shape(1) == 3 && noise.shape(1) == 3 && log_scales.shape(1) == 3 &&
              quats.shape(1) == 4,
          "rows are not of 3, 4, 3 and 3 numbers");
  require(quats.shape(0) == count && log_scales.shape(0) == count && noise.shape(0) == count &&
              opacity_logits.size() == count,
          "columns are not of one length");
  const NoiseJob<T> job = {means.data(), quats.data(), log_scales.data(), opacity_logits.data(),
                           noise.data(), T(rate), T(opacity), T(sharpness)};
  nb::gil_scoped_release unlocked;
  add_noise(job, int64_t(count), threads);
}

template <typename T>
void bind_type(nb::module_& module) {
  module.def("l1_dssim", &l1_dssim<T>, "rendered"_a.noconvert(), "target"_a.noconvert(),
             "valid"_a.noconvert().none(), "gradient"_a.noconvert().none(), "threads"_a,
             "Mean absolute difference and 1 - SSIM; the latter's gradient goes to ``gradient``.");
  module.def("l1_dssim_backward", &l1_dssim_backward<T>, "rendered"_a.noconvert(),
             "target"_a.noconvert(), "valid"_a.noconvert().none(), "dssim_gradient"_a.noconvert(),
             "l1"_a, "dssim"_a, "gradient"_a.noconvert(), "threads"_a,
             "Write to ``gradient`` what flows back for these gradients of the two losses.");
  module.def("adam", &adam<T>, "values"_a.noconvert(), "gradient"_a.noconvert(),
             "first"_a.noconvert(), "second"_a.noconvert(), "rows"_a.noconvert().none(), "beta1"_a,
             "beta2"_a, "bias2"_a, "rate"_a, "epsilon"_a, "gradient_limit"_a, "threads"_a,
             "One step of Adam in place, over all rows or over some; False, and nothing is done, if the "
             "numbers of a row lie apart.");
  module.def("all_finite", &is_all_finite<T>, "numbers"_a.noconvert(), "threads"_a,
             "Whether no number is infinite or NaN.");
  module.def("add_noise", &add_noise_to<T>, "means"_a.noconvert(), "quats"_a.noconvert(),
             "log_scales"_a.noconvert(), "opacity_logits"_a.noconvert(), "noise"_a.noconvert(),
             "rate"_a, "opacity"_a, "sharpness"_a, "threads"_a,
             "Add noise shaped by covariances to positions, in place.");
}

}  // namespace

void bind_step(nb::module_& module) {
  bind_type<float>(module);
  bind_type<double>(module);
}

}  // namespace gsfw
