// Checks of temporal fields that need no Python, for sanitizers and emulators.
//
// Results must be the same bits for any number of threads, and finite. It prints what is not and
// exits with 1, or exits with 0.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "check.h"
#include "field.h"
#include "instruction_sets.h"

namespace gsfw {
namespace {

constexpr int64_t CHANNELS = 32, SIDES[] = {2, 9};

template <typename T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

/// Features and gradients of places, some of which lie beyond the planes or are NaN.
template <typename T>
std::vector<T> products(int64_t count, int threads) {
  std::vector<T> places = uniform<T>(3 * count, 1, -1.3, 1.3);
  if (count > 2) places[4] = T(NAN);
  std::vector<std::vector<T>> planes, lines, to_planes, to_lines;
  std::vector<PlaneLevel<T>> levels;
  for (const int64_t side : SIDES) {
    planes.push_back(uniform<T>(3 * side * side * CHANNELS, 2, 0.1, 0.5));
    lines.push_back(uniform<T>(3 * side * CHANNELS, 3, 0.5, 1.5));
    to_planes.emplace_back(planes.back().size(), T(0));
    to_lines.emplace_back(lines.back().size(), T(0));
  }
  for (size_t i = 0; i < planes.size(); ++i) {
    levels.push_back({planes[i].data(), lines[i].data(), to_planes[i].data(), to_lines[i].data(),
                      SIDES[i]});
  }
  const PlaneProductJob<T> job = {places.data(), levels.data(), 2, CHANNELS, T(2)};
  std::vector<T> features(static_cast<size_t>(2 * CHANNELS * count)), moved(places.size(), T(0));
  plane_product(job, count, features.data(), threads);
  plane_product_backward(job, count, features.data(), moved.data(), threads);
  append(features, moved);
  for (size_t i = 0; i < planes.size(); ++i) {
    append(features, to_planes[i]);
    append(features, to_lines[i]);
  }
  return features;
}

/// Features and gradients of a hash grid with a row for each corner, and of one without.
template <typename T>
std::vector<T> hashes(int64_t count, int threads) {
  constexpr int64_t WIDTH = 4, ROWS = 256;
  std::vector<T> places = uniform<T>(3 * count, 1, -1.3, 1.3);
  if (count > 2) places[4] = T(NAN);
  const std::vector<T> table = uniform<T>(ROWS * WIDTH, 2, -1, 1);
  std::vector<T> dense(table.size(), T(0)), shared(table.size(), T(0));
  const HashLevel<T> levels[] = {
      {table.data(), dense.data(), ROWS, 4, 3, true, {1, 4, 16, 64}},
      {table.data(), shared.data(), ROWS, 20, 9, false, {1, 2654435761u, 805459861u, 3674653429u}}};
  const HashJob<T> job = {places.data(), T(1), levels, 2, WIDTH};
  std::vector<T> features(static_cast<size_t>(2 * WIDTH * count));
  hash_features(job, count, features.data(), threads);
  hash_features_backward(job, count, features.data(), threads);
  append(features, dense);
  append(features, shared);
  return features;
}

/// Outputs, with and without a gate, and gradients of a network with two layers and two heads.
template <typename T>
std::vector<T> networks(int64_t count, int threads) {
  constexpr int64_t SHAPES[][2] = {{16, 32}, {32, 64}, {32, 3}, {32, 17}};
  std::vector<std::vector<T>> numbers;
  int64_t size = 0;
  for (const auto& shape : SHAPES) {
    numbers.push_back(uniform<T>(shape[0] * shape[1], 4, -0.3, 0.3));
    numbers.push_back(uniform<T>(shape[1], 5, -0.3, 0.3));
    size += shape[1] * (shape[0] + 1);
  }
  NetworkWeights<T> weights;
  weights.trunk = 2;
  for (size_t i = 0; i < 4; ++i) {
    weights.layers.push_back(
        {numbers[2 * i].data(), numbers[2 * i + 1].data(), SHAPES[i][0], SHAPES[i][1]});
  }
  const std::vector<T> inputs = uniform<T>(16 * count, 6, -1, 1);
  std::vector<T> first(static_cast<size_t>(3 * count)), second(static_cast<size_t>(17 * count));
  std::vector<T> gate(first.size()), gated(second.size());
  const std::vector<T> least = uniform<T>(count, 7, -0.3, 0.3);
  network<T>(weights, inputs.data(), count, {least.data(), 0}, {gate.data(), gated.data()},
             threads);
  network<T>(weights, inputs.data(), count, {nullptr, 0}, {first.data(), second.data()}, threads);
  std::vector<T> to_inputs(inputs.size(), T(0)), to_weights(static_cast<size_t>(size));
  network_backward<T>(weights, inputs.data(), count, {first.data(), second.data()},
                      to_inputs.data(), to_weights.data(), threads);
  append(first, second);
  append(first, gated);
  append(first, to_inputs);
  append(first, to_weights);
  return first;
}

/// Slices of Gaussians of space and time and their gradients; one quaternion is zero.
template <typename T>
std::vector<T> slices(int64_t count, int threads) {
  std::vector<T> left = uniform<T>(4 * count, 1, -1, 1);
  const std::vector<T> right = uniform<T>(4 * count, 2, -1, 1);
  const std::vector<T> scales = uniform<T>(4 * count, 3, 0.01, 1);
  for (int k = 0; k < 4; ++k) left[size_t(k)] = T(0);
  std::vector<T> results(static_cast<size_t>(13 * count)), gradients(left.size() * 3);
  T* const to = results.data();
  const SliceJob<T> job = {left.data(), right.data(),     scales.data(),
                           to,          to + 9 * count, to + 12 * count};
  slice(job, count, threads);
  T* const back = gradients.data();
  slice_backward<T>(job, {to, to + 9 * count, to + 12 * count, back, back + 4 * count,
                          back + 8 * count},
                    count, threads);
  append(results, gradients);
  return results;
}

/// Values and gradients of the regularisers.
template <typename T>
std::vector<T> regularisers(int64_t inner, int threads) {
  const std::vector<T> grid = uniform<T>(5 * 3 * inner, 7, 0, 1);
  std::vector<T> gradient(grid.size()), results;
  for (const int order : {1, 2}) {
    const GridVariationJob<T> job = {grid.data(),       gradient.data(), {5, 3 * inner, T(0.5)},
                                     {3, inner, T(2)}, inner,           order};
    results.push_back(T(grid_variation(job, 15, threads)));
    append(results, gradient);
  }
  const int64_t count = int64_t(grid.size());
  results.push_back(T(grid_distance(grid.data(), count, 0.5, 2.0, gradient.data(), threads)));
  append(results, gradient);
  return results;
}

template <typename T>
void check(const std::string& name, std::vector<T> (*of)(int64_t, int), int64_t count) {
  const std::string what = name + " of " + std::to_string(count) + " rows";
  const std::vector<T> one = of(count, 1), three = of(count, 3);
  if (std::memcmp(one.data(), three.data(), one.size() * sizeof(T)) != 0) {
    fail(what + ": other bits with three threads");
  }
  for (const T x : one) {
    if (!std::isfinite(x)) return fail(what + ": not finite");
  }
}

template <typename T>
void check_all() {
  for (const int64_t count : {1, 15, 64, 3000}) {
    check<T>("products", products<T>, count);
    check<T>("hash grids", hashes<T>, count);
    check<T>("slices", slices<T>, count);
    check<T>("networks", networks<T>, count);
    check<T>("regularisers", regularisers<T>, count);
  }
}

}  // namespace
}  // namespace gsfw

int main() {
  for (const std::string& set : gsfw::instruction_sets()) {
    gsfw::use_instruction_set(set);
    gsfw::check_all<float>();
    gsfw::check_all<double>();
  }
  return gsfw::failures ? 1 : 0;
}
