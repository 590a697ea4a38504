// A small network of ReLU layers with linear heads, in tiles of rows whose activations stay in the
// cache. The backward pass computes the activations again, which costs less than storing them.
#pragma once

#include "field_stages.h"
#include "matrix_product.h"

namespace gsfw {
namespace GSFW_ISA {

/// Rows that pass through the network together.
constexpr int64_t NETWORK_TILE = 64;

GSFW_FUNCTION int64_t padded(int64_t count) { return (count + LANES - 1) / LANES * LANES; }

/// Widest activation of the network.
template <typename T>
GSFW_FUNCTION int64_t widest(const NetworkJob<T>& job) {
  int64_t most = job.layers[0].inputs;
  for (int64_t i = 0; i < job.trunk + job.heads; ++i) {
    const int64_t width = padded(job.layers[i].outputs);
    if (width > most) most = width;
  }
  return most;
}

template <typename T>
int64_t network_scratch(const NetworkJob<T>& job) {
  int64_t width = job.layers[0].inputs + 3 * widest(job);
  for (int64_t i = 0; i < job.trunk; ++i) width += job.layers[i].outputs;
  return NETWORK_TILE * width;
}

/// Outputs of the first ``count`` layers one after another from ``to`` on; returns that of the last.
template <typename T>
GSFW_FUNCTION const T* run_layers(const NetworkJob<T>& job, int64_t count, const T* inputs,
                                  int64_t rows, T* to) {
  const T* from = inputs;
  for (int64_t i = 0; i < count; ++i) {
    const DenseLayer<T>& layer = job.layers[i];
    multiply<Start::bias, true, T>(rows, layer.outputs, layer.inputs, {from, layer.inputs, 1},
                                   {layer.transposed, layer.outputs}, layer.biases,
                                   {to, layer.outputs});
    from = to;
    to += NETWORK_TILE * layer.outputs;
  }
  return from;
}

/// Outputs of a head on columns of ``from``, whose rows are ``width`` apart; padded, in ``to``.
template <typename T>
GSFW_FUNCTION void run_head(const DenseLayer<T>& head, int64_t rows, const T* from, int64_t width,
                            T* to) {
  const int64_t stride = padded(head.outputs);
  multiply<Start::bias, false, T>(rows, stride, head.inputs, {from, width, 1},
                                  {head.transposed, stride}, head.biases, {to, stride});
}

template <typename T>
GSFW_FUNCTION void copy_row(const T* from, int64_t width, T* to) {
  for (int64_t k = 0; k < width; ++k) to[k] = from[k];
}

/// A head and the part of the trunk's last layer that it reads, of activations before that layer.
template <typename T>
GSFW_FUNCTION void run_branch(const NetworkJob<T>& job, int64_t number, int64_t rows,
                              const T* before, T* hidden, T* to) {
  const DenseLayer<T>&joined = job.layers[job.trunk - 1], &head = job.layers[job.trunk + number];
  const int64_t begin = number * head.inputs;
  multiply<Start::bias, true, T>(rows, head.inputs, joined.inputs, {before, joined.inputs, 1},
                                 {joined.transposed + begin, joined.outputs},
                                 joined.biases + begin, {hidden, head.inputs});
  run_head(head, rows, hidden, head.inputs, to);
}

/// Memory of one tile: its inputs, three gradients, and the trunk's activations.
template <typename T>
struct NetworkTile {
  T *inputs, *head, *gradient, *next, *activations;

  GSFW_FUNCTION NetworkTile(const NetworkJob<T>& job, T* scratch) {
    const int64_t size = NETWORK_TILE * widest(job);
    inputs = scratch;
    head = inputs + NETWORK_TILE * job.layers[0].inputs;
    gradient = head + size;
    next = gradient + size;
    activations = next + size;
  }
};

/// Outputs of all heads for the rows of a tile from ``start`` on.
template <typename T>
GSFW_FUNCTION void run_heads(const NetworkJob<T>& job, int64_t start, int64_t rows, const T* last,
                             const NetworkTile<T>& tile) {
  const int64_t width = job.layers[job.trunk - 1].outputs;
  for (int64_t h = 0; h < job.heads; ++h) {
    const DenseLayer<T>& head = job.layers[job.trunk + h];
    run_head(head, rows, last + h * head.inputs, width, tile.head);
    T* const to = job.outputs[h] + start * head.outputs;
    for (int64_t r = 0; r < rows; ++r) {
      copy_row(tile.head + r * padded(head.outputs), head.outputs, to + r * head.outputs);
    }
  }
}

/// The same, with a gate: the other heads are evaluated for the rows that pass, packed together.
template <typename T>
GSFW_FUNCTION void run_gated_heads(const NetworkJob<T>& job, int64_t start, int64_t rows,
                                   const T* before, const NetworkTile<T>& tile) {
  const DenseLayer<T>& gate = job.layers[job.trunk + job.gate];
  const int64_t width = job.layers[job.trunk - 1].inputs;
  T *const packed = tile.gradient, *const hidden = tile.next;
  int64_t passed[NETWORK_TILE], count = 0;
  run_branch(job, job.gate, rows, before, hidden, tile.head);
  for (int64_t r = 0; r < rows; ++r) {
    const T* const from = tile.head + r * padded(gate.outputs);
    copy_row(from, gate.outputs, job.outputs[job.gate] + (start + r) * gate.outputs);
    if (from[0] < job.least[start + r]) continue;  // NaN passes.
    copy_row(before + r * width, width, packed + count * width);
    passed[count++] = r;
  }
  for (int64_t h = 0; h < job.heads; ++h) {
    if (h == job.gate) continue;
    const int64_t outputs = job.layers[job.trunk + h].outputs;
    T* const to = job.outputs[h] + start * outputs;
    for (int64_t k = 0; k < rows * outputs; ++k) to[k] = T(0);
    run_branch(job, h, count, packed, hidden, tile.head);
    for (int64_t i = 0; i < count; ++i) {
      copy_row(tile.head + i * padded(outputs), outputs, to + passed[i] * outputs);
    }
  }
}

/// Outputs of rows [begin, end).
template <typename T>
void network(const NetworkJob<T>& job, int64_t begin, int64_t end, T* scratch) {
  const NetworkTile<T> tile(job, scratch);
  const int64_t layers = job.least == nullptr ? job.trunk : job.trunk - 1;
  for (int64_t start = begin; start < end; start += NETWORK_TILE) {
    const int64_t rows = end - start < NETWORK_TILE ? end - start : NETWORK_TILE;
    const T* const inputs = job.inputs + start * job.layers[0].inputs;
    const T* const last = run_layers(job, layers, inputs, rows, tile.activations);
    if (job.least == nullptr) {
      run_heads(job, start, rows, last, tile);
    } else {
      run_gated_heads(job, start, rows, last, tile);
    }
  }
}

/// Zero the gradient where the activation is 0, and only there: NaN lets it through.
template <typename T>
GSFW_FUNCTION void mask_by_activation(const T* activation, int64_t count, T* gradient) {
  for (int64_t i = 0; i < count; i += LANES) {
    const LaneMask<T> off = load(activation + i) <= Pack<T>(0.0);
    store(gradient + i, keep(!off, load(gradient + i)));
  }
}

/// Add the gradients of a layer's weights and biases; ``width`` is the stride of ``inputs``.
template <typename T>
GSFW_FUNCTION void add_weights_gradient(const DenseLayer<T>& layer, int64_t rows, const T* inputs,
                                        int64_t width, const T* gradient, T* weights_gradient) {
  T* const weights = weights_gradient + layer.gradient;
  T* const biases = weights + layer.outputs * layer.inputs;
  multiply<Start::kept, false, T>(layer.outputs, layer.inputs, rows, {gradient, 1, layer.outputs},
                                  {inputs, width}, nullptr, {weights, layer.inputs});
  for (int64_t r = 0; r < rows; ++r) {
    for (int64_t k = 0; k < layer.outputs; ++k) biases[k] += gradient[r * layer.outputs + k];
  }
}

template <typename T>
GSFW_FUNCTION void gather_rows(const T* from, int64_t width, const int64_t* rows, int64_t count,
                               T* to) {
  for (int64_t r = 0; r < count; ++r) {
    for (int64_t k = 0; k < width; ++k) to[r * width + k] = from[rows[r] * width + k];
  }
}

/// From the heads' gradients to that of the trunk's output, in ``tile.gradient``.
template <typename T>
GSFW_FUNCTION void heads_backward(const NetworkJob<T>& job, const int64_t* rows, int64_t count,
                                  const NetworkTile<T>& tile, const T* last, T* weights_gradient) {
  const int64_t width = job.layers[job.trunk - 1].outputs;
  for (int64_t h = 0; h < job.heads; ++h) {
    const DenseLayer<T>& head = job.layers[job.trunk + h];
    gather_rows(job.gradients[h], head.outputs, rows, count, tile.head);
    multiply<Start::zero, false, T>(count, head.inputs, head.outputs, {tile.head, head.outputs, 1},
                                    {head.weights, head.inputs}, nullptr,
                                    {tile.gradient + h * head.inputs, width});
    add_weights_gradient(head, count, last + h * head.inputs, width, tile.head, weights_gradient);
  }
}

/// Gradients of a chunk of rows, tile by tile in order.
template <typename T>
void network_backward(const NetworkJob<T>& job, const NetworkChunk<T>& chunk, T* scratch) {
  const int64_t features = job.layers[0].inputs;
  for (int64_t start = 0; start < chunk.count; start += NETWORK_TILE) {
    const int64_t left = chunk.count - start, count = left < NETWORK_TILE ? left : NETWORK_TILE;
    const int64_t* const rows = chunk.rows + start;
    NetworkTile<T> tile(job, scratch);
    gather_rows(job.inputs, features, rows, count, tile.inputs);
    const T* activation = run_layers(job, job.trunk, tile.inputs, count, tile.activations);
    heads_backward(job, rows, count, tile, activation, chunk.weights_gradient);
    for (int64_t i = job.trunk - 1; i >= 0; --i) {
      const DenseLayer<T>& layer = job.layers[i];
      const T* const before = i > 0 ? activation - NETWORK_TILE * layer.inputs : tile.inputs;
      mask_by_activation(activation, count * layer.outputs, tile.gradient);
      add_weights_gradient(layer, count, before, layer.inputs, tile.gradient,
                           chunk.weights_gradient);
      if (i == 0 && chunk.inputs_gradient == nullptr) break;
      multiply<Start::zero, false, T>(count, layer.inputs, layer.outputs,
                                      {tile.gradient, layer.outputs, 1},
                                      {layer.weights, layer.inputs}, nullptr,
                                      {tile.next, layer.inputs});
      T* const swapped = tile.gradient;
      tile.gradient = tile.next;
      tile.next = swapped;
      activation = before;
    }
    for (int64_t r = 0; chunk.inputs_gradient != nullptr && r < count; ++r) {
      T* const to = chunk.inputs_gradient + rows[r] * features;
      for (int64_t k = 0; k < features; ++k) to[k] = tile.gradient[r * features + k];
    }
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
