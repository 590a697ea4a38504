// Rendering as Python sees it: the dataclasses of kernels/render_arguments.py in, a handle for the
// backward pass out.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>

#include "bands.h"
#include "bindings.h"
#include "last_words.h"
#include "python_arguments.h"
#include "render_pass.h"

namespace gsfw {
namespace {

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
    const int64_t n = arguments_.splats.count, w = arguments_.view.width;
    const int64_t h = arguments_.view.height, channels = channels_of(arguments_.splats);
    arguments_.background = array<const T>(inputs, "background", {channels});
    arguments_.pixel_weights = array<const T>(inputs, "pixel_weights", {h, w});
    const RenderOutputs<T> to = {{array<T>(outputs, "image", {h, w, channels}),
                                  array<T>(outputs, "alpha", {h, w}),
                                  array<T>(outputs, "contribution", {n})},
                                 array<uint8_t>(outputs, "visible", {n}),
                                 array<T>(outputs, "radii", {n})};
    const nb::gil_scoped_release release;
    pass_ = std::make_unique<RenderPass<T>>(arguments_, to);
  }

  void backward(const nb::object& gradients) {
    const ViewParameters<T>& view = arguments_.view;
    const ProjectGradients<T> rows = project_gradients_of<T>(gradients, arguments_.splats);
    const BlendGradients<T> pixels = blend_gradients_of<T>(
        gradients, view.width, view.height, channels_of(arguments_.splats), false);
    const nb::gil_scoped_release release;
    pass_->backward({pixels.image, pixels.alpha, rows});
  }

  nb::dict times() const { return times_of(pass_->times()); }
  int64_t pairs() const { return pass_->pairs(); }

 private:
  // Never the outputs: the image holds the autograd node that holds this, a cycle for ever.
  nb::object inputs_;
  RenderArguments<T> arguments_;
  std::unique_ptr<RenderPass<T>> pass_;
};

/// Rows that are divided by bands, with a hold on the arrays of their splats.
template <typename T>
class RowsHandle {
 public:
  RowsHandle(const nb::object& inputs, const nb::object& settings, const nb::object& outputs,
             int band_height, int threads)
      : inputs_(inputs), splats_(splats_of<T>(inputs.attr("splats"), settings)) {
    if (band_height < TILE || band_height % TILE) refuse("band_height", "whole tiles");
    const ViewParameters<T> view = view_of<T>(inputs, settings);
    const T level_min = cut_offs_of<T>(settings).level_min;
    uint8_t* visible = array<uint8_t>(outputs, "visible", {splats_.count});
    T* radii = array<T>(outputs, "radii", {splats_.count});
    const nb::gil_scoped_release release;
    rows_ = std::make_unique<BandedRows<T>>(view, splats_, level_min, band_height, threads, visible,
                                            radii);
  }

  std::vector<int64_t> counts() const { return rows_->counts(); }

  void pack(const nb::object& outputs) {
    T* to = array<T>(outputs, "rows", {total(), sent_fields(channels_of(splats_))});
    const nb::gil_scoped_release release;
    rows_->pack(to);
  }

  void backward(const nb::object& gradients) {
    const ProjectGradients<T> rows = project_gradients_of<T>(gradients, splats_);
    T* contribution = array<T>(gradients, "contribution", {splats_.count});
    const int64_t stride = SLOT_CHANNELS + channels_of(splats_) + (rows.absgrad ? 2 : 0) +
                           (contribution ? 1 : 0);
    const T* sums = array<const T>(gradients, "sums", {total(), stride});
    const nb::gil_scoped_release release;
    rows_->backward(sums, static_cast<int>(stride), rows, contribution);
  }

 private:
  int64_t total() const {
    int64_t sum = 0;
    for (const int64_t count : rows_->counts()) sum += count;
    return sum;
  }

  nb::object inputs_;
  SplatArrays<T> splats_;
  std::unique_ptr<BandedRows<T>> rows_;
};

/// One band of an image, with a hold on the arrays that its backward pass reads.
template <typename T>
class BandHandle {
 public:
  BandHandle(const nb::object& inputs, const nb::object& settings, const nb::object& outputs,
             int threads)
      : background_(inputs.attr("background")),
        pixel_weights_(inputs.attr("pixel_weights")),
        arguments_{} {
    nb::ndarray<> found;
    const T* rows = array<const T>(inputs, "rows", {ANY, ANY}, &found);
    count_ = static_cast<int64_t>(found.shape(0));
    arguments_.width = number<int>(settings, "width");
    arguments_.height = number<int>(settings, "height");
    arguments_.channels = static_cast<int>(found.shape(1)) - sent_fields(0);
    if (arguments_.channels < 1) refuse("rows", "splats as a band has them");
    arguments_.bounded = number<T>(settings, "alpha_min") > T(0);
    arguments_.cut_offs = cut_offs_of<T>(settings);
    arguments_.most_pairs = number<int64_t>(settings, "max_pairs");
    arguments_.threads = threads;
    const int64_t h = arguments_.height, w = arguments_.width, channels = arguments_.channels;
    arguments_.background = array<const T>(inputs, "background", {channels});
    arguments_.pixel_weights = array<const T>(inputs, "pixel_weights", {h, w});
    const int top = number<int>(inputs, "top");
    const BlendOutputs<T> to = {array<T>(outputs, "image", {h, w, channels}),
                                array<T>(outputs, "alpha", {h, w}),
                                array<T>(outputs, "contribution", {count_})};
    const nb::gil_scoped_release release;
    band_ = std::make_unique<Band<T>>(rows, count_, top, arguments_, to);
  }

  void backward(const nb::object& gradients) {
    const bool absolute = number<bool>(gradients, "absolute");
    const BlendGradients<T> pixels = blend_gradients_of<T>(
        gradients, arguments_.width, arguments_.height, arguments_.channels, absolute);
    const int64_t stride = SLOT_CHANNELS + arguments_.channels + (absolute ? 2 : 0);
    T* sums = array<T>(gradients, "sums", {count_, stride});
    const nb::gil_scoped_release release;
    band_->backward(pixels, sums);
  }

 private:
  nb::object background_, pixel_weights_;
  BlendArguments<T> arguments_;
  int64_t count_ = 0;
  std::unique_ptr<Band<T>> band_;
};

template <typename T>
void bind_handles(nb::module_& module, const std::string& type) {
  nb::class_<Handle<T>>(module, ("RenderPass" + type).c_str(),
                        "One camera's image, and its backward pass.")
      .def(nb::init<const nb::object&, const nb::object&, const nb::object&, int>(),
           nb::arg("inputs"), nb::arg("settings"), nb::arg("outputs"), nb::arg("threads"))
      .def("backward", &Handle<T>::backward, nb::arg("gradients"))
      .def("times", &Handle<T>::times)
      .def_prop_ro("pairs", &Handle<T>::pairs);
  nb::class_<RowsHandle<T>>(module, ("BandedRows" + type).c_str(),
                            "Splats in one camera's image, by the bands that they reach.")
      .def(nb::init<const nb::object&, const nb::object&, const nb::object&, int, int>(),
           nb::arg("inputs"), nb::arg("settings"), nb::arg("outputs"), nb::arg("band_height"),
           nb::arg("threads"))
      .def("pack", &RowsHandle<T>::pack, nb::arg("outputs"))
      .def("backward", &RowsHandle<T>::backward, nb::arg("gradients"))
      .def_prop_ro("counts", &RowsHandle<T>::counts);
  nb::class_<BandHandle<T>>(module, ("Band" + type).c_str(),
                            "One band of an image, and its backward pass.")
      .def(nb::init<const nb::object&, const nb::object&, const nb::object&, int>(),
           nb::arg("inputs"), nb::arg("settings"), nb::arg("outputs"), nb::arg("threads"))
      .def("backward", &BandHandle<T>::backward, nb::arg("gradients"));
}

}  // namespace

void bind_render(nb::module_& module) {
  bind_handles<float>(module, "Float32");
  bind_handles<double>(module, "Float64");
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
  module.attr("SENT_FIELDS") = sent_fields(0);
  module.def("release_render_memory", &release_render_memory,
             "Free the memory that is kept from one render to the next.");
  module.def("keep_freed_memory", &keep_freed_memory,
             "Let the process's allocator keep what is freed instead of giving it back.");
  module.def("set_last_words", &set_last_words, nb::arg("cause"), nb::arg("advice"), nb::arg("exit_code"),
             "Say something in place of a stack trace if the process aborts.");
  module.def("clear_last_words", &clear_last_words, "Let the process abort as it did before.");
}

}  // namespace gsfw
