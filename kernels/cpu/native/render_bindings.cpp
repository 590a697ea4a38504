// Rendering as Python sees it: the dataclasses of kernels/render_arguments.py in, a handle for the
// backward pass out.
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <initializer_list>
#include <string>
#include <type_traits>
#include <memory>

#include "bindings.h"
#include "render_pass.h"

namespace nb = nanobind;

namespace gsfw {
namespace {

/// In an expected shape: whatever is found.
constexpr int64_t ANY = -1;

[[noreturn]] void refuse(const char* name, const std::string& expected) {
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
bool rise_to(const int64_t* offsets, int64_t count, int64_t last) {
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

/// An image, with a hold on the arrays it was rendered from.
template <typename T>
class Handle {
 public:
  Handle(const nb::object& inputs, const nb::object& settings, const nb::object& outputs,
         int threads)
      : inputs_(inputs), arguments_{} {
    arguments_.view = view_of<T>(inputs, settings);
    arguments_.splats = splats_of<T>(inputs.attr("splats"), settings);
    arguments_.cut_offs = cut_offs_of<T>(settings);
    arguments_.most_pairs = number<int64_t>(settings, "max_pairs");
    arguments_.threads = threads;
    const SplatArrays<T>& splats = arguments_.splats;
    channels_ = splats.color_channels + splats.extras + splats.depth_channels;
    arguments_.background = array<const T>(inputs, "background", {channels_});
    const int64_t n = splats.count, w = arguments_.view.width, h = arguments_.view.height;
    arguments_.pixel_weights = array<const T>(inputs, "pixel_weights", {h, w});
    const RenderOutputs<T> to = {array<T>(outputs, "image", {h, w, channels_}),
                                  array<T>(outputs, "alpha", {h, w}),
                                  array<uint8_t>(outputs, "visible", {n}),
                                  array<T>(outputs, "radii", {n}),
                                  array<T>(outputs, "contribution", {n})};
    const nb::gil_scoped_release release;
    pass_ = std::make_unique<RenderPass<T>>(arguments_, to);
  }

  void backward(const nb::object& gradients) {
    const nb::object rows = gradients.attr("splats");
    const SplatArrays<T>& splats = arguments_.splats;
    const int64_t n = splats.count, w = arguments_.view.width, h = arguments_.view.height;
    const int64_t rest_rows = splats.offsets ? splats.offsets[n] : n;
    RenderGradients<T> to{};
    to.image = array<const T>(gradients, "image", {h, w, channels_});
    to.alpha = array<const T>(gradients, "alpha", {h, w});
    to.splats = {array<T>(rows, "means", {n, 3}),
                 array<T>(rows, "quats", {n, 4}),
                 array<T>(rows, "scales", {n, 3}),
                 array<T>(rows, "covariances", {n, 3, 3}),
                 array<T>(rows, "opacities", {n}),
                 array<T>(rows, "colors", {n, splats.color_stride}),
                 array<T>(rows, "rest", {rest_rows, splats.rest_stride}),
                 array<T>(rows, "extra", {n, splats.extras})};
    to.accumulate = number<bool>(gradients, "accumulate");
    to.pose = array<T>(gradients, "pose", {POSE_FIELDS});
    to.screen_gradient = array<T>(gradients, "screen_gradient", {n});
    to.absgrad = array<T>(gradients, "absgrad", {n});
    const nb::gil_scoped_release release;
    pass_->backward(to);
  }

  /// CPU and wall milliseconds of each stage.
  nb::dict times() const {
    static const char* const NAMES[STAGES] = {"project", "sort",           "bin",
                                              "blend",   "blend_backward", "project_backward"};
    nb::dict result;
    for (int stage = 0; stage < STAGES; ++stage) {
      const StageTime& time = pass_->times()[stage];
      result[NAMES[stage]] = nb::make_tuple(double(time.cpu) * 1e-6, double(time.wall) * 1e-6);
    }
    return result;
  }

  int64_t pairs() const { return pass_->pairs(); }

 private:
  // Never the outputs: the image holds the autograd node that holds this, a cycle for ever.
  nb::object inputs_;
  RenderArguments<T> arguments_;
  int64_t channels_ = 0;
  std::unique_ptr<RenderPass<T>> pass_;
};

template <typename T>
void bind_handle(nb::module_& module, const char* name) {
  nb::class_<Handle<T>>(module, name, "One camera's image, and its backward pass.")
      .def(nb::init<const nb::object&, const nb::object&, const nb::object&, int>(),
           nb::arg("inputs"), nb::arg("settings"), nb::arg("outputs"), nb::arg("threads"))
      .def("backward", &Handle<T>::backward, nb::arg("gradients"))
      .def("times", &Handle<T>::times)
      .def_prop_ro("pairs", &Handle<T>::pairs);
}

}  // namespace

void bind_render(nb::module_& module) {
  bind_handle<float>(module, "RenderPassFloat32");
  bind_handle<double>(module, "RenderPassFloat64");
  static nb::exception<TooManyPairs> too_many(module, "TooManyPairs", PyExc_RuntimeError);
  nb::register_exception_translator([](const std::exception_ptr& error, void*) {
    try {
      std::rethrow_exception(error);
    } catch (const TooManyPairs& refused) {
      PyErr_SetObject(too_many.ptr(), nb::int_(refused.count).ptr());
    }
  });
  module.attr("PAIR_BYTES") = PAIR_BYTES;
  module.attr("SLOT_FIELDS") = int(SLOT_CHANNELS);
  module.def("keep_freed_memory", &keep_freed_memory,
             "Let the process's allocator keep what is freed instead of giving it back.");
}

}  // namespace gsfw
