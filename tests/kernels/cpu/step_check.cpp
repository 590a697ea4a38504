// Checks of the losses and the optimizer that need no Python, for sanitizers and emulators.
//
// Results must be the same bits for any number of threads, and close to those of float64. It prints
// what is not and exits with 1, or exits with 0.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "check.h"
#include "instruction_sets.h"
#include "step.h"

namespace gsfw {
namespace {

struct Size {
  int64_t images, height, width, channels;

  int64_t pixels() const { return images * height * width; }
};

constexpr Size SIZES[] = {
    {1, 1, 1, 1}, {2, 17, 31, 3}, {1, 4, 1100, 1}, {1, 130, 9, 4}, {1, 3, 700, 3}};

/// Losses, their gradients and what a step leaves of a model, one after another.
template <typename T>
std::vector<T> losses_of(const Size& size, bool masked, int threads) {
  const int64_t numbers = size.pixels() * size.channels;
  const std::vector<T> rendered = uniform<T>(numbers, 1), target = uniform<T>(numbers, 2);
  std::vector<uint8_t> valid(static_cast<size_t>(size.pixels()));
  for (size_t i = 0; i < valid.size(); ++i) valid[i] = i % 5 != 2;
  const Comparison<T> images = {rendered.data(), target.data(), masked ? valid.data() : nullptr,
                                  size.images, size.height, size.width, size.channels};
  std::vector<T> gradient(static_cast<size_t>(numbers)), total(gradient);
  const Losses losses = l1_dissimilarity(images, gradient.data(), threads);
  loss_gradient(images, gradient.data(), 0.8, 0.2, total.data(), threads);
  std::vector<T> results = {T(losses.l1), T(losses.dissimilarity)};
  results.insert(results.end(), gradient.begin(), gradient.end());
  results.insert(results.end(), total.begin(), total.end());
  return results;
}

template <typename T>
std::vector<T> step_of(int64_t rows, int64_t width, bool listed, int threads) {
  const int64_t stride = width + 3, size = rows ? (rows - 1) * stride + width : 0;
  std::vector<T> values = uniform<T>(size, 3, -1, 1), first = uniform<T>(size, 4, -1, 1);
  std::vector<T> second = uniform<T>(size, 5, 0.01, 1);
  const std::vector<T> gradient = uniform<T>(size, 6, -1, 1);
  std::vector<int64_t> every_third;
  for (int64_t row = 0; row < rows; row += 3) every_third.push_back(row);
  const AdamJob<T> job = {{values.data(), stride}, {gradient.data(), stride},
                          {first.data(), stride}, {second.data(), stride}, width,
                          listed ? every_third.data() : nullptr, T(0.1), T(0.999), T(0.001),
                          T(0.002), T(0.01), T(1e-8), T(1e15)};
  adam_step(job, listed ? int64_t(every_third.size()) : rows, threads);
  values.insert(values.end(), first.begin(), first.end());
  values.insert(values.end(), second.begin(), second.end());
  return values;
}

/// Positions that noise has moved.
template <typename T>
std::vector<T> noise_of(int64_t rows, int threads) {
  std::vector<T> means = uniform<T>(3 * rows, 8, -1, 1);
  const std::vector<T> quats = uniform<T>(4 * rows, 9, -1, 1);
  const std::vector<T> log_scales = uniform<T>(3 * rows, 10, -5, -1);
  const std::vector<T> logits = uniform<T>(rows, 11, -9, 2), noise = uniform<T>(3 * rows, 12, -2, 2);
  const NoiseJob<T> job = {means.data(),  quats.data(), log_scales.data(), logits.data(),
                           noise.data(), T(2.0),       T(0.005),          T(100.0)};
  add_noise(job, rows, threads);
  return means;
}

/// Run ``results`` of float64 and of every instruction set, and compare.
template <typename F, typename G>
void check(const std::string& what, F of_float, G of_double) {
  const std::vector<double> exact = of_double(1);
  for (const std::string& set : instruction_sets()) {
    use_instruction_set(set);
    const std::vector<float> found = of_float(1);
    for (size_t i = 0; i < found.size(); ++i) {
      if (std::abs(double(found[i]) - exact[i]) <= 1e-4 * std::abs(exact[i]) + 1e-6) continue;
      fail(what + ", " + set + ": found " + std::to_string(found[i]) + ", expected " +
           std::to_string(exact[i]));
      break;
    }
    const size_t bytes = found.size() * sizeof(float);
    for (const int threads : {2, 5}) {
      const std::vector<float> other = of_float(threads);
      if (bytes == 0 || std::memcmp(found.data(), other.data(), bytes) == 0) continue;
      fail(what + ", " + set + ": differs on " + std::to_string(threads) + " threads");
    }
  }
}

void check_finite() {
  for (const std::string& set : instruction_sets()) {
    use_instruction_set(set);
    for (const int64_t count : {0, 1, 15, 16, 17, 100000}) {
      std::vector<float> numbers = uniform<float>(count, 7);
      if (!all_finite(numbers.data(), count, 2)) fail("finite numbers, " + set);
      if (count == 0) continue;
      numbers.back() = NAN;
      if (all_finite(numbers.data(), count, 2)) fail("a NaN at the end, " + set);
    }
  }
}

void check_everything() {
  for (const int64_t rows : {0, 1, 37, 9000}) {
    check("noise", [&](int threads) { return noise_of<float>(rows, threads); },
          [&](int threads) { return noise_of<double>(rows, threads); });
  }
  for (const Size& size : SIZES) {
    for (const bool masked : {false, true}) {
      const std::string what = "losses of width " + std::to_string(size.width);
      check(what, [&](int threads) { return losses_of<float>(size, masked, threads); },
            [&](int threads) { return losses_of<double>(size, masked, threads); });
    }
  }
  for (const int64_t width : {1, 3, 16, 45}) {
    for (const int64_t rows : {0, 1, 37, 3000}) {
      for (const bool listed : {false, true}) {
        const std::string what = "step of width " + std::to_string(width);
        check(what, [&](int threads) { return step_of<float>(rows, width, listed, threads); },
              [&](int threads) { return step_of<double>(rows, width, listed, threads); });
      }
    }
  }
  check_finite();
}

}  // namespace
}  // namespace gsfw

int main() {
  gsfw::check_everything();
  if (gsfw::failures) std::printf("%d failures in all\n", gsfw::failures);
  return gsfw::failures ? 1 : 0;
}
