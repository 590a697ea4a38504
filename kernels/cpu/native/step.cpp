#include "step.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include "instruction_sets.h"
#include "memory.h"
#include "pool.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                        \
  namespace SET {                                \
  extern const StepKernels<float> step_float32;  \
  extern const StepKernels<double> step_float64; \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE

namespace {

/// Standard deviation of SSIM's window in pixels, and its constants for data in [0, 1].
constexpr double SIGMA = 1.5, C1 = 0.01 * 0.01, C2 = 0.03 * 0.03;
/// Longer rows are cut into strips, so that what a sweep remembers stays in a second-level cache.
constexpr int64_t STRIP = 1024;
/// Tasks that a thread gets on average, and the least rows of one: each begins with ten rows above
/// its own.
constexpr int64_t TASKS_PER_THREAD = 2, TASK_ROWS = 48;
/// Numbers that are one task where memory is only streamed through.
constexpr int64_t STREAM = 1 << 15;

template <typename T>
const StepKernels<T>& kernels();

template <>
const StepKernels<float>& kernels<float>() {
  return GSFW_CHOOSE(step_float32);
}

template <>
const StepKernels<double>& kernels<double>() {
  return GSFW_CHOOSE(step_float64);
}

template <typename T>
void set_window(T* window) {
  double weights[SSIM_TAPS], total = 0;
  for (int k = 0; k < SSIM_TAPS; ++k) {
    const double offset = k - SSIM_REACH;
    weights[k] = std::exp(-(offset * offset) / (2 * SIGMA * SIGMA));
    total += weights[k];
  }
  for (int k = 0; k <= SSIM_REACH; ++k) window[k] = T(weights[k] / total);
}

int64_t divide_up(int64_t a, int64_t b) { return (a + b - 1) / b; }

/// Numbers that count.
template <typename T>
int64_t valid_numbers(const Comparison<T>& images) {
  const int64_t pixels = images.images * images.height * images.width;
  if (images.valid == nullptr) return pixels * images.channels;
  int64_t valid = 0;
  for (int64_t i = 0; i < pixels; ++i) valid += images.valid[i] != 0;
  return valid * images.channels;
}

double ordered_sum(const std::vector<double>& numbers) {
  double total = 0;
  for (const double number : numbers) total += number;
  return total;
}

/// Working memory of the thread that asks, kept for its next call.
template <typename T>
T* scratch_of_thread(int64_t size) {
  thread_local Buffer<T> buffer;
  return buffer.reserve(size_t(size));
}

template <typename T>
void sweep_images(const SsimJob<T>& job, int threads) {
  const int64_t images = job.images.images, height = job.images.height;
  const int64_t columns = images * job.strips;
  const int64_t wanted = threads > 1 ? divide_up(threads * TASKS_PER_THREAD, columns) : 1;
  const int64_t per_band = std::max(divide_up(height, wanted), TASK_ROWS);
  const int64_t bands = divide_up(height, per_band);
  const StepKernels<T>& with = kernels<T>();
  parallel(columns * bands, threads, [&](int64_t number, int) {
    const int64_t top = number % bands * per_band, rest = number / bands;
    const SsimTask task = {rest / job.strips, top, std::min(top + per_band, height),
                           rest % job.strips};
    with.ssim(job, task, scratch_of_thread<T>(with.ssim_scratch(job)));
  });
}

}  // namespace

template <typename T>
Losses l1_dissimilarity(const Comparison<T>& images, T* gradient, int threads) {
  const int64_t valid = valid_numbers(images);
  const double share = 1.0 / double(std::max<int64_t>(valid, 1));
  SsimJob<T> job;
  job.images = images;
  set_window(job.window);
  job.c1 = T(C1);
  job.c2 = T(C2);
  job.gradient = gradient;
  job.gradient_scale = T(-share);
  const int64_t row_length = images.width * images.channels;
  job.strip_length = divide_up(divide_up(row_length, divide_up(row_length, STRIP)), 16) * 16;
  job.strips = divide_up(row_length, job.strip_length);
  std::vector<double> l1(images.images * images.height * job.strips), lack(l1.size());
  job.l1_sums = l1.data();
  job.lack_sums = lack.data();
  sweep_images(job, threads);
  return {ordered_sum(l1) * share, valid > 0 ? ordered_sum(lack) * share : 1.0};
}

template <typename T>
void loss_gradient(const Comparison<T>& images, const T* dissimilarity_gradient, double l1,
                   double dissimilarity, T* gradient, int threads) {
  const double share = 1.0 / double(std::max<int64_t>(valid_numbers(images), 1));
  const LossGradientJob<T> job = {images, dissimilarity_gradient, T(l1 * share),
                                  T(dissimilarity), gradient};
  const int64_t pixels = images.images * images.height * images.width;
  const int64_t grain = divide_up(STREAM, images.channels);
  parallel_pieces(pixels, grain, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().loss_gradient(job, begin, end);
  });
}

template <typename T>
void adam_step(const AdamJob<T>& job, int64_t count, int threads) {
  const int64_t grain = divide_up(STREAM, std::max<int64_t>(job.width, 1));
  parallel_pieces(count, grain, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().adam(job, begin, end);
  });
}

template <typename T>
bool all_finite(const T* numbers, int64_t count, int threads) {
  std::atomic<bool> finite{true};
  parallel_pieces(count, STREAM, threads, [&](int64_t begin, int64_t end, int) {
    if (!finite.load(std::memory_order_relaxed)) return;
    if (!kernels<T>().all_finite(numbers + begin, end - begin)) finite.store(false);
  });
  return finite.load();
}

template <typename T>
void add_noise(const NoiseJob<T>& job, int64_t count, int threads) {
  parallel_pieces(count, STREAM / 16, threads, [&](int64_t begin, int64_t end, int) {
    kernels<T>().add_noise(job, begin, end);
  });
}

#define GSFW_FOR_TYPE(T)                                                                \
  template Losses l1_dissimilarity(const Comparison<T>&, T*, int);                      \
  template void loss_gradient(const Comparison<T>&, const T*, double, double, T*, int); \
  template void adam_step(const AdamJob<T>&, int64_t, int);                             \
  template bool all_finite(const T*, int64_t, int);                                     \
  template void add_noise(const NoiseJob<T>&, int64_t, int);
GSFW_FOR_TYPE(float)
GSFW_FOR_TYPE(double)
#undef GSFW_FOR_TYPE

}  // namespace gsfw
