// Plain structures of the temporal field's kernels, the same in every translation unit, and one
// table of functions per instruction set and type.
#pragma once

#include <stdint.h>

namespace gsfw {

/// Planes of a resolution: their values, and the gradients that the backward pass adds to.
template <typename T>
struct PlaneLevel {
  /// [3, side, side, channels]: planes xy, xz and yz.
  const T* planes;
  /// [3, side, channels]: the time planes xt, yt and zt at one time.
  const T* lines;
  T* planes_gradient;
  T* lines_gradient;
  int64_t side;
};

/// Products of six planes' features at some places.
template <typename T>
struct PlaneProductJob {
  /// [n, 3] in [-1, 1]; constant beyond.
  const T* places;
  const PlaneLevel<T>* levels;
  int64_t level_count;
  /// Features of a cell, a multiple of 16.
  int64_t channels;
  /// Factor of every product.
  T scale;
};

/// Rows of the backward pass.
template <typename T>
struct FieldRows {
  /// [count]: rows whose gradient is not zero.
  const int64_t* rows;
  int64_t count;
  /// [n, levels * channels]: gradient of the features.
  const T* gradient;
};

/// A table of a hash grid.
template <typename T>
struct HashLevel {
  /// [rows, channels], and its gradient, which the backward pass adds to.
  const T* table;
  T* gradient;
  int64_t rows;
  /// Corners along each axis of space, and along time; at least 2.
  int64_t side, times;
  /// Each corner has a row of its own; the factors are then distances in rows, else those of a
  /// hash, and the rows a power of two.
  bool dense;
  uint64_t factors[4];
};

/// Features of some places at one time.
template <typename T>
struct HashJob {
  /// [n, 3] in [-1, 1]; constant beyond.
  const T* places;
  /// In [0, 1].
  T time;
  const HashLevel<T>* levels;
  int64_t level_count, channels;
};

/// Weights of a fully connected layer: y = W x + b.
template <typename T>
struct DenseLayer {
  /// Multiples of 16, but for the outputs of a head.
  int64_t inputs, outputs;
  /// [outputs, inputs], as torch has them.
  const T* weights;
  /// [inputs, padded outputs] and [padded outputs], zero where padded to a multiple of 16.
  const T* transposed;
  const T* biases;
  /// Where its gradients lie among those of the network: [outputs, inputs], then [outputs].
  int64_t gradient;
};

/// A network of ReLU layers, the trunk, and linear heads on equal parts of its last output.
template <typename T>
struct NetworkJob {
  /// [n, inputs of the first layer]
  const T* inputs;
  /// The trunk's layers, at least one, and then the heads.
  const DenseLayer<T>* layers;
  int64_t trunk, heads;
  /// By head: [n, outputs]; in the backward pass ``gradients`` are theirs.
  T* const* outputs;
  const T* const* gradients;
  /// [n], or null: other heads are zero in rows where the first output of head ``gate`` is below.
  const T* least;
  int64_t gate;
};

/// A chunk of rows of the network's backward pass.
template <typename T>
struct NetworkChunk {
  /// [count]: rows whose gradient is not zero.
  const int64_t* rows;
  int64_t count;
  /// [n, inputs]: gradient of the inputs; null if not wanted.
  T* inputs_gradient;
  /// Gradients of all weights and biases, which are added to.
  T* weights_gradient;
};

/// Slices of Gaussians of space and time; all rows lie next to one another.
template <typename T>
struct SliceJob {
  /// [n, 4]: left and right quaternion, wxyz, of any norm; scales along x, y, z, t.
  const T *left, *right, *scales;
  /// [n, 9], [n, 3], [n]; not read in the backward pass.
  T *covariances, *velocities, *variances;
};

/// Incoming gradients, and those of the inputs.
template <typename T>
struct SliceGradients {
  const T *covariances, *velocities, *variances;
  T *left, *right, *scales;
};

/// An axis of a grid along which neighbours are compared.
template <typename T>
struct GridAxis {
  /// Cells along it, and numbers from a cell to the next.
  int64_t cells, stride;
  /// Factor of the squared differences.
  T weight;
};

/// Squared differences of the cells of a grid [outer, first, second, inner].
template <typename T>
struct GridVariationJob {
  const T* grid;
  /// Like the grid; null if not wanted.
  T* gradient;
  GridAxis<T> first, second;
  /// Numbers of a cell.
  int64_t inner;
  /// 1 for first differences along both axes, 2 for second differences along the first.
  int order;
};

/// See plane_product.h, hash_features.h, slice.h, grid_variation.h and network.h.
template <typename T>
struct FieldKernels {
  void (*plane_product)(const PlaneProductJob<T>& job, int64_t begin, int64_t end, T* features);
  /// ``moved`` [count, 3]: gradient of the places by sixteen channels of a level.
  void (*plane_product_backward)(const PlaneProductJob<T>& job, const FieldRows<T>& rows,
                                 int64_t level, int64_t channel, T* moved);
  void (*hash_features)(const HashJob<T>& job, int64_t begin, int64_t end, T* features);
  void (*hash_features_backward)(const HashJob<T>& job, const FieldRows<T>& rows, int64_t level);
  void (*slice)(const SliceJob<T>& job, int64_t begin, int64_t end);
  void (*slice_backward)(const SliceJob<T>& job, const SliceGradients<T>& gradients, int64_t begin,
                         int64_t end);
  double (*grid_variation)(const GridVariationJob<T>& job, int64_t begin, int64_t end);
  double (*grid_distance)(const T* values, int64_t count, T center, T weight, T* gradient);
  /// Working memory of one thread, in numbers of T.
  int64_t (*network_scratch)(const NetworkJob<T>& job);
  void (*network)(const NetworkJob<T>& job, int64_t begin, int64_t end, T* scratch);
  void (*network_backward)(const NetworkJob<T>& job, const NetworkChunk<T>& chunk, T* scratch);
};

}  // namespace gsfw
