// Temporal fields, as Python sees them: the caller's arrays, neither copied nor converted.
#include "bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "field.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace gsfw {
namespace {

template <typename T, size_t AXES>
using Array = nb::ndarray<T, nb::ndim<AXES>, nb::c_contig, nb::device::cpu>;
template <typename T, size_t AXES>
using Arrays = std::vector<Array<T, AXES>>;

void require(bool fits, const char* complaint) {
  if (!fits) throw std::invalid_argument(complaint);
}

/// Levels of planes [3, side, side, channels] and lines [3, side, channels], and their gradients.
template <typename T>
std::vector<PlaneLevel<T>> levels_of(const Arrays<const T, 4>& planes,
                                     const Arrays<const T, 3>& lines, Arrays<T, 4>* to_planes,
                                     Arrays<T, 3>* to_lines) {
  require(!planes.empty() && planes.size() == lines.size(), "planes and lines are not in pairs");
  require(to_planes == nullptr ||
              (to_planes->size() == planes.size() && to_lines->size() == lines.size()),
          "gradients do not fit the planes and lines");
  std::vector<PlaneLevel<T>> levels;
  const size_t channels = planes[0].shape(3);
  require(channels % 16 == 0, "the channels are not a multiple of 16");
  for (size_t i = 0; i < planes.size(); ++i) {
    const size_t side = planes[i].shape(1);
    const auto fits = [&](const auto& plane, const auto& line) {
      return plane.shape(0) == 3 && plane.shape(1) == side && plane.shape(2) == side &&
             plane.shape(3) == channels && line.shape(0) == 3 && line.shape(1) == side &&
             line.shape(2) == channels;
    };
    require(side >= 2 && fits(planes[i], lines[i]), "a plane or line has another shape");
    require(to_planes == nullptr || fits((*to_planes)[i], (*to_lines)[i]),
            "a gradient has another shape than its plane or line");
    levels.push_back({planes[i].data(), lines[i].data(),
                      to_planes ? (*to_planes)[i].data() : nullptr,
                      to_lines ? (*to_lines)[i].data() : nullptr, int64_t(side)});
  }
  return levels;
}

template <typename T>
void bound_plane_product(const Array<const T, 2>& places, const Arrays<const T, 4>& planes,
                         const Arrays<const T, 3>& lines, double scale,
                         const Array<T, 2>& features, int threads) {
  const auto levels = levels_of<T>(planes, lines, nullptr, nullptr);
  const int64_t channels = int64_t(planes[0].shape(3)), count = int64_t(places.shape(0));
  require(places.shape(1) == 3 && int64_t(features.shape(0)) == count &&
              int64_t(features.shape(1)) == channels * int64_t(levels.size()),
          "places or features do not fit");
  const PlaneProductJob<T> job = {places.data(), levels.data(), int64_t(levels.size()), channels,
                                  T(scale)};
  T* const to = features.data();
  nb::gil_scoped_release unlocked;
  plane_product(job, count, to, threads);
}

template <typename T>
void bound_plane_product_backward(const Array<const T, 2>& places, const Arrays<const T, 4>& planes,
                                  const Arrays<const T, 3>& lines, double scale,
                                  const Array<const T, 2>& gradient,
                                  const Array<T, 2>& places_gradient, Arrays<T, 4> to_planes,
                                  Arrays<T, 3> to_lines, int threads) {
  const auto levels = levels_of<T>(planes, lines, &to_planes, &to_lines);
  const int64_t channels = int64_t(planes[0].shape(3)), count = int64_t(places.shape(0));
  require(places.shape(1) == 3 && places_gradient.shape(1) == 3 &&
              int64_t(places_gradient.shape(0)) == count &&
              int64_t(gradient.shape(0)) == count &&
              int64_t(gradient.shape(1)) == channels * int64_t(levels.size()),
          "places or gradients do not fit");
  const PlaneProductJob<T> job = {places.data(), levels.data(), int64_t(levels.size()), channels,
                                  T(scale)};
  const T* const from = gradient.data();
  T* const to = places_gradient.data();
  nb::gil_scoped_release unlocked;
  plane_product_backward(job, count, from, to, threads);
}

/// Levels of tables [rows, channels] for corners of cells along space and time.
template <typename T>
std::vector<HashLevel<T>> hash_levels(const Arrays<const T, 2>& tables,
                                      const std::vector<std::pair<int64_t, int64_t>>& sizes,
                                      const std::vector<uint64_t>& primes,
                                      Arrays<T, 2>* gradients) {
  require(!tables.empty() && tables.size() == sizes.size() && primes.size() == 4,
          "expected a size for each table, and four factors");
  require(gradients == nullptr || gradients->size() == tables.size(),
          "gradients do not fit the tables");
  std::vector<HashLevel<T>> levels;
  for (size_t i = 0; i < tables.size(); ++i) {
    const uint64_t rows = tables[i].shape(0), side = uint64_t(sizes[i].first);
    const uint64_t times = uint64_t(sizes[i].second);
    require(sizes[i].first >= 2 && sizes[i].second >= 2 && side < 1 << 15 && times < 1 << 15 &&
                tables[i].shape(1) == tables[0].shape(1),
            "a table or its size does not fit");
    const bool dense = side * side * side * times <= rows;
    require(dense || (rows > 0 && (rows & (rows - 1)) == 0), "a hashed table is no power of two");
    require(gradients == nullptr || ((*gradients)[i].shape(0) == rows &&
                                     (*gradients)[i].shape(1) == tables[0].shape(1)),
            "a gradient has another shape than its table");
    HashLevel<T> level = {tables[i].data(), gradients ? (*gradients)[i].data() : nullptr,
                          int64_t(rows), int64_t(side), int64_t(times), dense,
                          {primes[0], primes[1], primes[2], primes[3]}};
    if (dense) {
      const uint64_t strides[4] = {1, side, side * side, side * side * side};
      for (int axis = 0; axis < 4; ++axis) level.factors[axis] = strides[axis];
    }
    levels.push_back(level);
  }
  return levels;
}

template <typename T>
void bound_hash_features(const Array<const T, 2>& places, double time,
                         const Arrays<const T, 2>& tables,
                         const std::vector<std::pair<int64_t, int64_t>>& sizes,
                         const std::vector<uint64_t>& primes, const Array<T, 2>& features,
                         int threads) {
  const auto levels = hash_levels<T>(tables, sizes, primes, nullptr);
  const int64_t channels = int64_t(tables[0].shape(1)), count = int64_t(places.shape(0));
  require(places.shape(1) == 3 && int64_t(features.shape(0)) == count &&
              int64_t(features.shape(1)) == channels * int64_t(levels.size()),
          "places or features do not fit");
  const HashJob<T> job = {places.data(), T(time), levels.data(), int64_t(levels.size()), channels};
  T* const to = features.data();
  nb::gil_scoped_release unlocked;
  hash_features(job, count, to, threads);
}

template <typename T>
void bound_hash_features_backward(const Array<const T, 2>& places, double time,
                                  const Arrays<const T, 2>& tables,
                                  const std::vector<std::pair<int64_t, int64_t>>& sizes,
                                  const std::vector<uint64_t>& primes,
                                  const Array<const T, 2>& gradient, Arrays<T, 2> to_tables,
                                  int threads) {
  const auto levels = hash_levels<T>(tables, sizes, primes, &to_tables);
  const int64_t channels = int64_t(tables[0].shape(1)), count = int64_t(places.shape(0));
  require(places.shape(1) == 3 && int64_t(gradient.shape(0)) == count &&
              int64_t(gradient.shape(1)) == channels * int64_t(levels.size()),
          "places or gradients do not fit");
  const HashJob<T> job = {places.data(), T(time), levels.data(), int64_t(levels.size()), channels};
  const T* const from = gradient.data();
  nb::gil_scoped_release unlocked;
  hash_features_backward(job, count, from, threads);
}

template <typename T>
void bound_slice(const Array<const T, 2>& left, const Array<const T, 2>& right,
                 const Array<const T, 2>& scales, const Array<T, 2>& covariances,
                 const Array<T, 2>& velocities, const Array<T, 1>& variances, int threads) {
  const size_t count = left.shape(0);
  const auto fits = [&](const auto& of, size_t width) {
    return of.shape(0) == count && of.shape(1) == width;
  };
  require(fits(left, 4) && fits(right, 4) && fits(scales, 4) && fits(covariances, 9) &&
              fits(velocities, 3) && variances.shape(0) == count,
          "an array does not fit the number of rows");
  const SliceJob<T> job = {left.data(),        right.data(),      scales.data(),
                           covariances.data(), velocities.data(), variances.data()};
  nb::gil_scoped_release unlocked;
  slice(job, int64_t(count), threads);
}

template <typename T>
void bound_slice_backward(const Array<const T, 2>& left, const Array<const T, 2>& right,
                          const Array<const T, 2>& scales, const Array<const T, 2>& covariances,
                          const Array<const T, 2>& velocities, const Array<const T, 1>& variances,
                          const Array<T, 2>& to_left, const Array<T, 2>& to_right,
                          const Array<T, 2>& to_scales, int threads) {
  const size_t count = left.shape(0);
  const auto fits = [&](const auto& of, size_t width) {
    return of.shape(0) == count && of.shape(1) == width;
  };
  require(fits(left, 4) && fits(right, 4) && fits(scales, 4) && fits(covariances, 9) &&
              fits(velocities, 3) && variances.shape(0) == count && fits(to_left, 4) &&
              fits(to_right, 4) && fits(to_scales, 4),
          "an array does not fit the number of rows");
  const SliceJob<T> job = {left.data(), right.data(), scales.data(), nullptr, nullptr, nullptr};
  const SliceGradients<T> gradients = {covariances.data(), velocities.data(), variances.data(),
                                       to_left.data(),     to_right.data(),   to_scales.data()};
  nb::gil_scoped_release unlocked;
  slice_backward(job, gradients, int64_t(count), threads);
}

template <typename T>
double bound_grid_variation(const Array<const T, 4>& grid, int order, double first_weight,
                            double second_weight, const std::optional<Array<T, 4>>& gradient,
                            int threads) {
  require(order == 1 || order == 2, "the order of differences is neither 1 nor 2");
  for (size_t axis = 0; gradient && axis < 4; ++axis) {
    require(gradient->shape(axis) == grid.shape(axis), "the gradient has another shape");
  }
  const int64_t second = int64_t(grid.shape(2)), inner = int64_t(grid.shape(3));
  const GridVariationJob<T> job = {grid.data(),
                                   gradient ? gradient->data() : nullptr,
                                   {int64_t(grid.shape(1)), second * inner, T(first_weight)},
                                   {second, inner, T(second_weight)},
                                   inner,
                                   order};
  const int64_t cells = int64_t(grid.shape(0)) * int64_t(grid.shape(1)) * second;
  nb::gil_scoped_release unlocked;
  return grid_variation(job, cells, threads);
}

template <typename T>
double bound_grid_distance(const Array<const T, 1>& values, double center, double weight,
                           const std::optional<Array<T, 1>>& gradient, int threads) {
  require(!gradient || gradient->shape(0) == values.shape(0), "the gradient has another shape");
  const T* const from = values.data();
  T* const to = gradient ? gradient->data() : nullptr;
  const int64_t count = int64_t(values.shape(0));
  nb::gil_scoped_release unlocked;
  return grid_distance(from, count, center, weight, to, threads);
}

/// Layers of a network: the trunk's in sequence, the heads on equal parts of its last output.
template <typename T>
NetworkWeights<T> network_of(const Array<const T, 2>& inputs, const Arrays<const T, 2>& weights,
                             const Arrays<const T, 1>& biases, int64_t trunk) {
  require(weights.size() == biases.size() && trunk >= 1 && trunk < int64_t(weights.size()),
          "expected a trunk and heads, each layer with weights and biases");
  NetworkWeights<T> network;
  network.trunk = trunk;
  const int64_t heads = int64_t(weights.size()) - trunk;
  int64_t expected = int64_t(inputs.shape(1));
  for (size_t i = 0; i < weights.size(); ++i) {
    const int64_t outputs = int64_t(weights[i].shape(0)), given = int64_t(weights[i].shape(1));
    if (int64_t(i) == trunk) {
      require(expected % heads == 0, "the heads do not share the trunk's output equally");
      expected /= heads;
    }
    require(given == expected && int64_t(biases[i].shape(0)) == outputs && outputs >= 1 &&
                given % 16 == 0,
            "a layer does not fit, or has inputs that are no multiple of 16");
    network.layers.push_back({weights[i].data(), biases[i].data(), given, outputs});
    if (int64_t(i) < trunk) expected = outputs;
  }
  return network;
}

template <typename A>
void require_outputs(const A& arrays, size_t rows, const std::vector<int64_t>& widths) {
  require(arrays.size() == widths.size(), "expected an array for each head");
  for (size_t h = 0; h < arrays.size(); ++h) {
    require(arrays[h].shape(0) == rows && int64_t(arrays[h].shape(1)) == widths[h],
            "an array does not fit its head");
  }
}

template <typename T>
std::vector<int64_t> head_widths(const NetworkWeights<T>& network) {
  std::vector<int64_t> widths;
  for (size_t i = size_t(network.trunk); i < network.layers.size(); ++i) {
    widths.push_back(network.layers[i].outputs);
  }
  return widths;
}

template <typename T>
void bound_network(const Array<const T, 2>& inputs, const Arrays<const T, 2>& weights,
                   const Arrays<const T, 1>& biases, int64_t trunk,
                   const std::optional<Array<const T, 1>>& least, int64_t gate,
                   Arrays<T, 2> outputs, int threads) {
  const NetworkWeights<T> layers = network_of<T>(inputs, weights, biases, trunk);
  const auto widths = head_widths(layers);
  require_outputs(outputs, inputs.shape(0), widths);
  require(!least || least->shape(0) == inputs.shape(0), "expected a limit for each row");
  require(!least || (gate >= 0 && gate < int64_t(widths.size())), "the gate is no head");
  std::vector<T*> to;
  for (const auto& output : outputs) to.push_back(output.data());
  const T* const from = inputs.data();
  const NetworkGate<T> with = {least ? least->data() : nullptr, gate};
  const int64_t count = int64_t(inputs.shape(0));
  nb::gil_scoped_release unlocked;
  network(layers, from, count, with, to, threads);
}

template <typename T>
void bound_network_backward(const Array<const T, 2>& inputs, const Arrays<const T, 2>& weights,
                            const Arrays<const T, 1>& biases, int64_t trunk,
                            const Arrays<const T, 2>& gradients,
                            const std::optional<Array<T, 2>>& inputs_gradient,
                            const Array<T, 1>& weights_gradient, int threads) {
  const NetworkWeights<T> layers = network_of<T>(inputs, weights, biases, trunk);
  const auto widths = head_widths(layers);
  require_outputs(gradients, inputs.shape(0), widths);
  int64_t size = 0;
  for (const auto& layer : layers.layers) size += layer.outputs * (layer.inputs + 1);
  require(int64_t(weights_gradient.shape(0)) == size, "the weights' gradient has another size");
  require(!inputs_gradient || (inputs_gradient->shape(0) == inputs.shape(0) &&
                               inputs_gradient->shape(1) == inputs.shape(1)),
          "the inputs' gradient has another shape");
  std::vector<const T*> from;
  for (const auto& gradient : gradients) from.push_back(gradient.data());
  const T* const given = inputs.data();
  T* const to_inputs = inputs_gradient ? inputs_gradient->data() : nullptr;
  T* const to_weights = weights_gradient.data();
  const int64_t count = int64_t(inputs.shape(0));
  nb::gil_scoped_release unlocked;
  network_backward(layers, given, count, from, to_inputs, to_weights, threads);
}

template <typename T>
void bind_type(nb::module_& module) {
  module.def("plane_product", &bound_plane_product<T>, "places"_a.noconvert(), "planes"_a,
             "lines"_a, "scale"_a, "features"_a.noconvert(), "threads"_a,
             "Write the products of six planes' features at places.");
  module.def("plane_product_backward", &bound_plane_product_backward<T>, "places"_a.noconvert(),
             "planes"_a, "lines"_a, "scale"_a, "gradient"_a.noconvert(),
             "places_gradient"_a.noconvert(), "planes_gradients"_a, "lines_gradients"_a,
             "threads"_a, "Add the gradients of places, planes and lines to zeroed arrays.");
  module.def("hash_features", &bound_hash_features<T>, "places"_a.noconvert(), "time"_a,
             "tables"_a, "sizes"_a, "primes"_a, "features"_a.noconvert(), "threads"_a,
             "Write the interpolated rows of every table.");
  module.def("hash_features_backward", &bound_hash_features_backward<T>, "places"_a.noconvert(),
             "time"_a, "tables"_a, "sizes"_a, "primes"_a, "gradient"_a.noconvert(),
             "tables_gradients"_a, "threads"_a, "Add the tables' gradients to arrays of zeros.");
  module.def("slice", &bound_slice<T>, "left"_a.noconvert(), "right"_a.noconvert(),
             "scales"_a.noconvert(), "covariances"_a.noconvert(), "velocities"_a.noconvert(),
             "variances"_a.noconvert(), "threads"_a, "Slice Gaussians of space and time.");
  module.def("slice_backward", &bound_slice_backward<T>, "left"_a.noconvert(),
             "right"_a.noconvert(), "scales"_a.noconvert(), "covariances"_a.noconvert(),
             "velocities"_a.noconvert(), "variances"_a.noconvert(), "to_left"_a.noconvert(),
             "to_right"_a.noconvert(), "to_scales"_a.noconvert(), "threads"_a,
             "Write the gradients of quaternions and scales.");
  module.def("grid_variation", &bound_grid_variation<T>, "grid"_a.noconvert(), "order"_a,
             "first_weight"_a, "second_weight"_a, "gradient"_a.noconvert().none(), "threads"_a,
             "Weighted sum of squared differences along axes 1 and 2, and its gradient.");
  module.def("grid_distance", &bound_grid_distance<T>, "values"_a.noconvert(), "center"_a,
             "weight"_a, "gradient"_a.noconvert().none(), "threads"_a,
             "Sum of |value - center|; ``gradient`` receives ``weight`` times its sign.");
  module.def("network", &bound_network<T>, "inputs"_a.noconvert(), "weights"_a, "biases"_a,
             "trunk"_a, "least"_a.noconvert().none(), "gate"_a, "outputs"_a, "threads"_a,
             "Write the outputs of a network's heads; a gate says which rows need them.");
  module.def("network_backward", &bound_network_backward<T>, "inputs"_a.noconvert(), "weights"_a,
             "biases"_a, "trunk"_a, "gradients"_a, "inputs_gradient"_a.noconvert().none(),
             "weights_gradient"_a.noconvert(), "threads"_a,
             "Write the gradients of a network's weights, and of its inputs to a zeroed array.");
}

}  // namespace

void bind_field(nb::module_& module) {
  bind_type<float>(module);
  bind_type<double>(module);
}

}  // namespace gsfw
