#include "field.h"

#include <algorithm>
#include <numeric>

#include "instruction_sets.h"
#include "memory.h"
#include "pool.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                         \
  namespace SET {                                 \
  extern const FieldKernels<float> field_float32; \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE

namespace scalar {
extern const FieldKernels<double> field_float64;
}

namespace {

constexpr int64_t LANES = 16;
/// Rows of a task where every row is computed by itself, a multiple of the network's tile.
constexpr int64_t TASK_ROWS = 512;
/// Numbers that are one task where memory is only streamed through.
constexpr int64_t STREAM = 1 << 15;
/// Most chunks whose gradients of weights are summed apart.
constexpr int64_t MOST_CHUNKS = 64;

template <typename T>
const FieldKernels<T>& kernels();

template <>
const FieldKernels<float>& kernels<float>() {
  return GSFW_CHOOSE(field_float32);
}

template <>
const FieldKernels<double>& kernels<double>() {
  return scalar::field_float64;
}

int64_t divide_up(int64_t a, int64_t b) { return (a + b - 1) / b; }

template <typename T>
T* scratch_of_thread(int64_t size) {
  thread_local Buffer<T> buffer;
  return buffer.reserve(size_t(size));
}

template <typename T>
struct Gradients {
  const T* data;
  int64_t width;
};

/// Rows in which any of the gradients is not zero, in order.
template <typename T>
std::vector<int64_t> rows_with_gradient(const std::vector<Gradients<T>>& gradients, int64_t count,
                                        int threads) {
  std::vector<uint8_t> found(static_cast<size_t>(count), 0);
  parallel_pieces(count, 4 * TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    for (const Gradients<T>& of : gradients) {
      for (int64_t row = begin; row < end; ++row) {
        bool any = false;
        for (int64_t k = 0; k < of.width; ++k) any |= of.data[row * of.width + k] != T(0);
        found[row] |= uint8_t(any);
      }
    }
  });
  std::vector<int64_t> rows;
  rows.reserve(size_t(count));
  for (int64_t row = 0; row < count; ++row) {
    if (found[row]) rows.push_back(row);
  }
  return rows;
}

/// Bits of a cell's number along an axis: 64 cells, those of the usual coarsest planes.
constexpr int CELL_BITS = 6;

/// Cell of a place in [-1, 1]^3 along a Z-order curve: neighbours in space are near one another.
template <typename T>
uint32_t curve_cell(const T* place) {
  uint32_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const T scaled = (place[axis] + T(1)) * T(1 << (CELL_BITS - 1));
    const T top = T((1 << CELL_BITS) - 1);
    const uint32_t cell = scaled > T(0) ? uint32_t(scaled < top ? scaled : top) : 0;
    for (int bit = 0; bit < CELL_BITS; ++bit) key |= (cell >> bit & 1u) << (3 * bit + axis);
  }
  return key;
}

/// The rows along the curve, those of one cell in their order: planes are then read and written
/// cell by cell, from the cache.
template <typename T>
void sort_along_curve(const T* places, std::vector<int64_t>& rows) {
  std::vector<uint32_t> keys(rows.size());
  for (size_t i = 0; i < rows.size(); ++i) keys[i] = curve_cell(places + 3 * rows[i]);
  std::vector<int64_t> starts((size_t(1) << 3 * CELL_BITS) + 1, 0);
  for (const uint32_t key : keys) ++starts[key + 1];
  for (size_t k = 1; k < starts.size(); ++k) starts[k] += starts[k - 1];
  std::vector<int64_t> sorted(rows.size());
  for (size_t i = 0; i < rows.size(); ++i) sorted[size_t(starts[keys[i]]++)] = rows[i];
  rows.swap(sorted);
}

/// A network's layers with their weights transposed and padded.
template <typename T>
class PackedNetwork {
 public:
  explicit PackedNetwork(const NetworkWeights<T>& network) {
    int64_t size = 0;
    for (const LayerWeights<T>& of : network.layers) size += padded(of.outputs) * (of.inputs + 1);
    memory_.assign(size_t(size), T(0));
    T* to = memory_.data();
    for (const LayerWeights<T>& of : network.layers) {
      const int64_t width = padded(of.outputs);
      DenseLayer<T> layer = {of.inputs, of.outputs, of.weights, to, to + width * of.inputs, size_};
      for (int64_t out = 0; out < of.outputs; ++out) {
        for (int64_t in = 0; in < of.inputs; ++in) {
          to[in * width + out] = of.weights[out * of.inputs + in];
        }
        to[width * of.inputs + out] = of.biases[out];
      }
      to += width * (of.inputs + 1);
      size_ += of.outputs * (of.inputs + 1);
      layers_.push_back(layer);
    }
  }

  NetworkJob<T> job(const T* inputs, int64_t trunk, T* const* outputs,
                    const T* const* gradients) const {
    const int64_t heads = int64_t(layers_.size()) - trunk;
    return {inputs, layers_.data(), trunk, heads, outputs, gradients, nullptr, 0};
  }

  /// Numbers of all weights and biases.
  int64_t size() const { return size_; }

 private:
  static int64_t padded(int64_t count) { return divide_up(count, LANES) * LANES; }

  std::vector<T> memory_;
  std::vector<DenseLayer<T>> layers_;
  int64_t size_ = 0;
};

}  // namespace

template <typename T>
void plane_product(const PlaneProductJob<T>& job, int64_t count, T* features, int threads) {
  parallel_pieces(count, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().plane_product(job, begin, end, features);
  });
}

template <typename T>
void plane_product_backward(const PlaneProductJob<T>& job, int64_t count, const T* gradient,
                            T* places_gradient, int threads) {
  const int64_t features = job.level_count * job.channels;
  auto rows = rows_with_gradient<T>({{gradient, features}}, count, threads);
  sort_along_curve(job.places, rows);
  const int64_t active = int64_t(rows.size()), packs = job.channels / LANES;
  const int64_t tasks = job.level_count * packs;
  const FieldRows<T> of = {rows.data(), active, gradient};
  // Apart from the scratch of tasks, which run on this thread too.
  std::vector<T> parts(size_t(tasks * active * 3));
  T* const moved = parts.data();
  parallel(tasks, threads, [&](int64_t task, int) {
    kernels<T>().plane_product_backward(job, of, task / packs, task % packs * LANES,
                                        moved + task * active * 3);
  });
  parallel_pieces(active, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    for (int64_t i = 3 * begin; i < 3 * end; ++i) {
      T total = T(0);
      for (int64_t task = 0; task < tasks; ++task) total += moved[task * active * 3 + i];
      places_gradient[3 * rows[size_t(i / 3)] + i % 3] = total;
    }
  });
}

template <typename T>
void hash_features(const HashJob<T>& job, int64_t count, T* features, int threads) {
  parallel_pieces(count, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().hash_features(job, begin, end, features);
  });
}

template <typename T>
void hash_features_backward(const HashJob<T>& job, int64_t count, const T* gradient, int threads) {
  auto rows = rows_with_gradient<T>({{gradient, job.level_count * job.channels}}, count, threads);
  sort_along_curve(job.places, rows);
  const FieldRows<T> of = {rows.data(), int64_t(rows.size()), gradient};
  parallel(job.level_count, threads, [&](int64_t task, int) {
    // The finest level first: its rows lie farthest apart.
    kernels<T>().hash_features_backward(job, of, job.level_count - 1 - task);
  });
}

template <typename T>
void slice(const SliceJob<T>& job, int64_t count, int threads) {
  parallel_pieces(count, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().slice(job, begin, end);
  });
}

template <typename T>
void slice_backward(const SliceJob<T>& job, const SliceGradients<T>& gradients, int64_t count,
                    int threads) {
  parallel_pieces(count, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().slice_backward(job, gradients, begin, end);
  });
}

template <typename T>
double grid_variation(const GridVariationJob<T>& job, int64_t cells, int threads) {
  const int64_t grain = std::max<int64_t>(STREAM / job.inner, 1);
  std::vector<double> sums(size_t(divide_up(cells, grain)));
  parallel_pieces(cells, grain, threads, [&](int64_t begin, int64_t end, int) {
    sums[size_t(begin / grain)] = kernels<T>().grid_variation(job, begin, end);
  });
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

template <typename T>
double grid_distance(const T* values, int64_t count, double center, double weight, T* gradient,
                     int threads) {
  std::vector<double> sums(size_t(divide_up(count, STREAM)));
  parallel_pieces(count, STREAM, threads, [&](int64_t begin, int64_t end, int) {
    T* const to = gradient ? gradient + begin : nullptr;
    sums[size_t(begin / STREAM)] =
        kernels<T>().grid_distance(values + begin, end - begin, T(center), T(weight), to);
  });
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

template <typename T>
void network(const NetworkWeights<T>& weights, const T* inputs, int64_t count,
             const NetworkGate<T>& gate, const std::vector<T*>& outputs, int threads) {
  const PackedNetwork<T> packed(weights);
  NetworkJob<T> job = packed.job(inputs, weights.trunk, outputs.data(), nullptr);
  job.least = gate.least;
  job.gate = gate.head;
  const FieldKernels<T>& with = kernels<T>();
  parallel_pieces(count, TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    with.network(job, begin, end, scratch_of_thread<T>(with.network_scratch(job)));
  });
}

template <typename T>
void network_backward(const NetworkWeights<T>& weights, const T* inputs, int64_t count,
                      const std::vector<const T*>& gradients, T* inputs_gradient,
                      T* weights_gradient, int threads) {
  std::vector<Gradients<T>> found;
  for (size_t h = 0; h < gradients.size(); ++h) {
    found.push_back({gradients[h], weights.layers[size_t(weights.trunk) + h].outputs});
  }
  const auto rows = rows_with_gradient<T>(found, count, threads);
  const PackedNetwork<T> packed(weights);
  const NetworkJob<T> job = packed.job(inputs, weights.trunk, nullptr, gradients.data());
  const FieldKernels<T>& with = kernels<T>();
  const int64_t least = divide_up(divide_up(int64_t(rows.size()), MOST_CHUNKS), TASK_ROWS);
  const int64_t grain = std::max<int64_t>(least, 1) * TASK_ROWS;
  const int64_t chunks = divide_up(int64_t(rows.size()), grain);
  std::vector<T> sums(size_t(chunks * packed.size()), T(0));
  parallel_pieces(int64_t(rows.size()), grain, threads, [&](int64_t begin, int64_t end, int) {
    const NetworkChunk<T> chunk = {rows.data() + begin, end - begin, inputs_gradient,
                                   sums.data() + begin / grain * packed.size()};
    with.network_backward(job, chunk, scratch_of_thread<T>(with.network_scratch(job)));
  });
  parallel_pieces(packed.size(), TASK_ROWS, threads, [&](int64_t begin, int64_t end, int) {
    for (int64_t i = begin; i < end; ++i) {
      T total = T(0);
      for (int64_t c = 0; c < chunks; ++c) total += sums[size_t(c * packed.size() + i)];
      weights_gradient[i] = total;
    }
  });
}

#define GSFW_FOR_TYPE(T)                                                                          \
  template void plane_product(const PlaneProductJob<T>&, int64_t, T*, int);                       \
  template void plane_product_backward(const PlaneProductJob<T>&, int64_t, const T*, T*, int);    \
  template void hash_features(const HashJob<T>&, int64_t, T*, int);                                \
  template void hash_features_backward(const HashJob<T>&, int64_t, const T*, int);                \
  template void slice(const SliceJob<T>&, int64_t, int);                                          \
  template void slice_backward(const SliceJob<T>&, const SliceGradients<T>&, int64_t, int);       \
  template double grid_variation(const GridVariationJob<T>&, int64_t, int);                       \
  template double grid_distance(const T*, int64_t, double, double, T*, int);                      \
  template void network(const NetworkWeights<T>&, const T*, int64_t, const NetworkGate<T>&,        \
                        const std::vector<T*>&, int);                                             \
  template void network_backward(const NetworkWeights<T>&, const T*, int64_t,                     \
                                 const std::vector<const T*>&, T*, T*, int);
GSFW_FOR_TYPE(float)
GSFW_FOR_TYPE(double)
#undef GSFW_FOR_TYPE

}  // namespace gsfw
