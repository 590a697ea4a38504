// Temporal fields: products of planes, hash grids, slices, small networks and regularisers, forward
// and backward.
//
// Results are the same to the bit for any number of threads: rows are computed by themselves, and
// sums over rows are taken in chunks whose size depends on the number of rows only, in order.
// Rows whose incoming gradient is zero, which no pixel shows, are left out of the backward pass of
// planes, hash grids and networks.
#pragma once

#include <vector>

#include "field_stages.h"

namespace gsfw {

/// Features [n, levels * channels] of ``count`` places.
template <typename T>
void plane_product(const PlaneProductJob<T>& job, int64_t count, T* features, int threads);

/// Gradients of places [n, 3], planes and lines, all of which are zero before.
template <typename T>
void plane_product_backward(const PlaneProductJob<T>& job, int64_t count, const T* gradient,
                            T* places_gradient, int threads);

/// Features [n, levels * channels] of ``count`` places.
template <typename T>
void hash_features(const HashJob<T>& job, int64_t count, T* features, int threads);

/// Gradients of the tables, which are zero before.
template <typename T>
void hash_features_backward(const HashJob<T>& job, int64_t count, const T* gradient, int threads);

/// Slices of ``count`` Gaussians of space and time.
template <typename T>
void slice(const SliceJob<T>& job, int64_t count, int threads);

/// Their gradients.
template <typename T>
void slice_backward(const SliceJob<T>& job, const SliceGradients<T>& gradients, int64_t count,
                    int threads);

/// Weighted sum of squared differences of a grid of ``cells`` cells.
template <typename T>
double grid_variation(const GridVariationJob<T>& job, int64_t cells, int threads);

/// Sum of |value - center|; ``gradient`` (null if not wanted) receives ``weight`` times its sign.
template <typename T>
double grid_distance(const T* values, int64_t count, double center, double weight, T* gradient,
                     int threads);

/// Weights as torch has them, [outputs, inputs] and [outputs].
template <typename T>
struct LayerWeights {
  const T* weights;
  const T* biases;
  int64_t inputs, outputs;
};

/// A network of ReLU layers with linear heads.
template <typename T>
struct NetworkWeights {
  /// The trunk's layers, and then the heads.
  std::vector<LayerWeights<T>> layers;
  int64_t trunk;
};

/// A head whose first output decides for each row if the other heads are needed.
template <typename T>
struct NetworkGate {
  /// [n]: the other heads are zero in rows where it is below; null for no gate.
  const T* least;
  int64_t head;
};

/// Outputs of each head, [n, outputs], for ``inputs`` [n, inputs of the first layer].
template <typename T>
void network(const NetworkWeights<T>& weights, const T* inputs, int64_t count,
             const NetworkGate<T>& gate, const std::vector<T*>& outputs, int threads);

/// Gradients of the inputs (null if not wanted; zero before) and of every layer's weights followed
/// by its biases, one layer after another.
template <typename T>
void network_backward(const NetworkWeights<T>& weights, const T* inputs, int64_t count,
                      const std::vector<const T*>& gradients, T* inputs_gradient,
                      T* weights_gradient, int threads);

}  // namespace gsfw
