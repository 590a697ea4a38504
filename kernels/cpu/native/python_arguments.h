// Python arguments: the dataclasses of kernels/render_arguments.py as the structures of rendering.
#pragma once

#include <nanobind/ndarray.h>

#include <initializer_list>
#include <string>
#include <type_traits>

#include "blend_pass.h"
#include "stage_times.h"

namespace gsfw {

namespace nb = nanobind;

/// In an expected shape: whatever is found.
constexpr int64_t ANY = -1;

[[noreturn]] inline void refuse(const char* name, const std::string& expected) {
  throw nb::value_error((std::string(name) + ": expected " + expected).c_str());
}

/// The memory of the tensor in a field, null where that is None; checked, never copied.
template <typename T>
T* array(const nb::object& holder, const char* name, std::initializer_list<int64_t> shape,
         nb::ndarray<>* found = nullptr) {
  nb::object value = holder.attr(name);
  if (value.is_none()) return nullptr;
  nb::ndarray<> tensor = nb::cast<nb::ndarray<>>(value);
  const auto wanted = std::is_same_v<std::remove_const_t<T>, uint8_t>
                          ? nb::dtype<bool>()
                          : nb::dtype<std::remove_const_t<T>>();
  if (tensor.dtype() != wanted) refuse(name, "another dtype");
  if (tensor.device_type() != nb::device::cpu::value) refuse(name, "a tensor on the CPU");
  if (tensor.ndim() != shape.size()) refuse(name, "another number of dimensions");
  int64_t stride = 1;
  for (size_t axis = shape.size(); axis-- > 0;) {
    const int64_t size = static_cast<int64_t>(tensor.shape(axis));
    const int64_t expected = shape.begin()[axis];
    if (expected != ANY && size != expected) refuse(name, "another shape");
    if (size > 1 && tensor.stride(axis) != stride) refuse(name, "a contiguous tensor");
    stride *= size;
  }
  if (found) *found = tensor;
  // An empty tensor may have no memory, but it is there.
  static std::remove_const_t<T> nothing{};
  return tensor.data() ? static_cast<T*>(tensor.data()) : &nothing;
}

/// Whether ``offsets`` rise from 0 to ``last`` in ``count`` steps, which keeps rows inside memory.
inline bool rise_to(const int64_t* offsets, int64_t count, int64_t last) {
  bool falls = false;
  for (int64_t i = 0; i < count; ++i) falls |= offsets[i + 1] < offsets[i];
  return !falls && offsets[0] == 0 && offsets[count] == last;
}

template <typename N>
N number(const nb::object& holder, const char* name) {
  return nb::cast<N>(holder.attr(name));
}

template <typename T>
ViewParameters<T> view_of(const nb::object& inputs, const nb::object& settings) {
  ViewParameters<T> view{};
  const T* world_to_camera = array<const T>(inputs, "world_to_camera", {4, 4});
  const T* intrinsics = array<const T>(inputs, "intrinsics", {3, 3});
  for (int i = 0; i < 12; ++i) view.world_to_camera[i] = world_to_camera[i];
  view.focal_x = intrinsics[0];
  view.focal_y = intrinsics[4];
  view.principal_x = intrinsics[2];
  view.principal_y = intrinsics[5];
  view.width = number<int>(settings, "width");
  view.height = number<int>(settings, "height");
  view.model = number<int>(settings, "camera_model");
  view.jacobian_margin = number<T>(settings, "jacobian_margin");
  view.dilation = number<T>(settings, "dilation");
  view.compensation_min = number<T>(settings, "compensation_min");
  view.alpha_min = number<T>(settings, "alpha_min");
  view.near = number<T>(settings, "near");
  view.far = number<T>(settings, "far");
  view.length_max = number<T>(settings, "length_max");
  view.quaternion_min_norm = number<T>(settings, "quaternion_min_norm");
  view.antialias = number<bool>(settings, "antialias");
  return view;
}

/// Check that rows have what the active degree reads of them; ``rest`` has ``rest_rows`` rows.
template <typename T>
void check_coefficients(const SplatArrays<T>& splats, int64_t rest_rows) {
  const int needed = 3 * (splats.sh_degree + 1) * (splats.sh_degree + 1);
  if (splats.sh_degree > 4) refuse("sh_degree", "at most 4");
  if (splats.rest && (splats.sh_degree < 0 || splats.color_stride != 3)) {
    refuse("rest", "one constant coefficient in colors");
  }
  if (splats.offsets) {
    if (!splats.rest || splats.rest_stride != 3) refuse("rest", "rows of three numbers");
    if (!rise_to(splats.offsets, splats.count, rest_rows)) {
      refuse("offsets", "numbers that rise from 0 to the rows of rest");
    }
  } else if (splats.sh_degree >= 0 && splats.color_stride + splats.rest_stride < needed) {
    refuse("colors", "the coefficients of its degree");
  }
}

template <typename T>
SplatArrays<T> splats_of(const nb::object& arrays, const nb::object& settings) {
  SplatArrays<T> splats{};
  nb::ndarray<> means, colors, rest, extra;
  splats.means = array<const T>(arrays, "means", {ANY, 3}, &means);
  const int64_t n = static_cast<int64_t>(means.shape(0));
  splats.count = n;
  splats.quats = array<const T>(arrays, "quats", {n, 4});
  splats.scales = array<const T>(arrays, "scales", {n, 3});
  splats.covariances = array<const T>(arrays, "covariances", {n, 3, 3});
  splats.opacities = array<const T>(arrays, "opacities", {n});
  splats.colors = array<const T>(arrays, "colors", {n, ANY}, &colors);
  splats.color_stride = static_cast<int>(colors.shape(1));
  splats.sh_degree = number<int>(settings, "sh_degree");
  splats.offsets = array<const int64_t>(arrays, "offsets", {n + 1});
  splats.rest = array<const T>(arrays, "rest", {splats.offsets ? ANY : n, ANY}, &rest);
  splats.rest_stride = splats.rest ? static_cast<int>(rest.shape(1)) : 0;
  splats.extra = array<const T>(arrays, "extra", {n, ANY}, &extra);
  splats.extras = splats.extra ? static_cast<int>(extra.shape(1)) : 0;
  splats.color_channels = splats.sh_degree >= 0 ? 3 : splats.color_stride;
  splats.depth_channels = number<int>(settings, "depth_channels");
  check_coefficients(splats, splats.rest ? static_cast<int64_t>(rest.shape(0)) : 0);
  if (!splats.covariances && !(splats.quats && splats.scales)) refuse("quats", "both forms given");
  return splats;
}

template <typename T>
CutOffs<T> cut_offs_of(const nb::object& settings) {
  return {number<T>(settings, "level_min"), number<T>(settings, "alpha_cap"),
          number<T>(settings, "alpha_limit"), number<T>(settings, "transmittance_min")};
}

/// The arrays of gradients of splats; null where not wanted.
template <typename T>
ProjectGradients<T> project_gradients_of(const nb::object& gradients,
                                         const SplatArrays<T>& splats) {
  const nb::object rows = gradients.attr("splats");
  const int64_t n = splats.count, rest_rows = splats.offsets ? splats.offsets[n] : n;
  return {{array<T>(rows, "means", {n, 3}), array<T>(rows, "quats", {n, 4}),
           array<T>(rows, "scales", {n, 3}), array<T>(rows, "covariances", {n, 3, 3}),
           array<T>(rows, "opacities", {n}), array<T>(rows, "colors", {n, splats.color_stride}),
           array<T>(rows, "rest", {rest_rows, splats.rest_stride}),
           array<T>(rows, "extra", {n, splats.extras})},
          number<bool>(gradients, "accumulate"),
          array<T>(gradients, "pose", {POSE_FIELDS}),
          array<T>(gradients, "screen_gradient", {n}),
          array<T>(gradients, "absgrad", {n})};
}

/// What the pixels of a gradient say; its image has ``channels``.
template <typename T>
BlendGradients<T> blend_gradients_of(const nb::object& gradients, int width, int height,
                                     int channels, bool absolute) {
  return {array<const T>(gradients, "image", {height, width, channels}),
          array<const T>(gradients, "alpha", {height, width}), absolute};
}

/// CPU and wall milliseconds of each stage.
inline nb::dict times_of(const StageTimes& times) {
  static const char* const NAMES[STAGES] = {"project", "sort",           "bin",
                                            "blend",   "blend_backward", "project_backward"};
  nb::dict result;
  for (int stage = 0; stage < STAGES; ++stage) {
    result[NAMES[stage]] =
        nb::make_tuple(double(times[stage].cpu) * 1e-6, double(times[stage].wall) * 1e-6);
  }
  return result;
}

}  // namespace gsfw
