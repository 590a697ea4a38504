// One step of Adam in one pass over memory (Kingma and Ba 2015, algorithm 1).
//
// As gsfw.core.operators has it. Whether the step counts, and how many there were, is read where it
// lies, so that the host waits for nothing.
#include "step_stages.h"

namespace gsfw {
namespace cuda {

/// See ``BeginAdamJob``. One warp; it is a kernel of its own because every block of the others must
/// see the same count.
template <class T>
__global__ void __launch_bounds__(WARP) begin_adam(BeginAdamJob job) {
  if (threadIdx.x != 0 || *job.finite == 0) return;
  const double count = *job.count + 1.0;
  *job.count = count;
  T* scales = static_cast<T*>(job.scales);
  scales[0] = T(job.rate / (1.0 - GSFW_ELEMENTARY(pow)(job.beta1, count)));
  scales[1] = T(1.0 / (1.0 - GSFW_ELEMENTARY(pow)(job.beta2, count)));
}

/// ``AdamJob``'s constants as T.
template <class T>
struct AdamConstants {
  T weight1, decay2, weight2, epsilon, limit, rate, correction2;

  __device__ __forceinline__ explicit AdamConstants(const AdamJob& job)
      : weight1(T(job.weight1)),
        decay2(T(job.decay2)),
        weight2(T(job.weight2)),
        epsilon(T(job.epsilon)),
        limit(T(job.gradient_limit)),
        rate(static_cast<const T*>(job.scales)[0]),
        correction2(static_cast<const T*>(job.scales)[1]) {}
};

/// Step one number and its moments.
template <class T>
__device__ __forceinline__ void step_number(const AdamConstants<T>& is, T gradient, T& value,
                                            T& first, T& second) {
  const T g = clamp(gradient, -is.limit, is.limit);
  first = fma(is.weight1, g - first, first);
  second = fma(is.weight2 * g, g, second * is.decay2);
  value -= first / (square_root(second * is.correction2) + is.epsilon) * is.rate;
}

/// First elements of the arrays of a job.
template <class T>
struct AdamArrays {
  T *values, *first, *second;
  const T* gradient;

  __device__ __forceinline__ explicit AdamArrays(const AdamJob& job)
      : values(static_cast<T*>(job.values.numbers)),
        first(static_cast<T*>(job.first.numbers)),
        second(static_cast<T*>(job.second.numbers)),
        gradient(static_cast<const T*>(job.gradient.numbers)) {}
};

/// Four numbers that are moved together, 16 bytes at a time.
template <class T>
struct alignas(16) Quad {
  T at[ADAM_NUMBERS];
};

/// Step the four numbers from ``at`` on.
template <class T>
__device__ __forceinline__ void step_quad(const AdamConstants<T>& is, const AdamArrays<T>& of,
                                          int64 at) {
  Quad<T>* values = reinterpret_cast<Quad<T>*>(of.values + at);
  Quad<T>* firsts = reinterpret_cast<Quad<T>*>(of.first + at);
  Quad<T>* seconds = reinterpret_cast<Quad<T>*>(of.second + at);
  const Quad<T> gradient = *reinterpret_cast<const Quad<T>*>(of.gradient + at);
  Quad<T> value = *values, first = *firsts, second = *seconds;
#pragma unroll
  for (int i = 0; i < ADAM_NUMBERS; ++i) {
    step_number(is, gradient.at[i], value.at[i], first.at[i], second.at[i]);
  }
  *values = value;
  *firsts = first;
  *seconds = second;
}

/// See ``AdamJob``: all rows, which follow one another without gaps. Every thread steps
/// ADAM_NUMBERS numbers next to one another.
template <class T>
__global__ void __launch_bounds__(ADAM_THREADS) adam(AdamJob job) {
  if (*job.finite == 0) return;
  const AdamConstants<T> is(job);
  const AdamArrays<T> of(job);
  const int64 end = job.count * job.width, from = thread_index() * ADAM_NUMBERS;
  if (job.aligned && from + ADAM_NUMBERS <= end) return step_quad(is, of, from);
  for (int64 i = from; i < end && i < from + ADAM_NUMBERS; ++i) {
    step_number(is, of.gradient[i], of.values[i], of.first[i], of.second[i]);
  }
}

/// See ``AdamJob``: rows that lie apart, or some rows of all. Neighbouring threads step numbers
/// next to each other, ADAM_NUMBERS times over.
template <class T>
__global__ void __launch_bounds__(ADAM_THREADS) adam_rows(AdamJob job) {
  if (*job.finite == 0) return;
  const AdamConstants<T> is(job);
  const AdamArrays<T> of(job);
  const int64 from = int64(blockIdx.x) * (ADAM_THREADS * ADAM_NUMBERS);
  const int64 first_place = from / job.width;
  const uint32 width = uint32(job.width), before = uint32(from - first_place * job.width);
#pragma unroll
  for (int i = 0; i < ADAM_NUMBERS; ++i) {
    // Within a block 32 bits suffice, which divide much faster.
    const uint32 number = before + uint32(i * ADAM_THREADS) + threadIdx.x;
    const int64 place = first_place + number / width;
    if (place >= job.count) return;
    const int64 row = job.rows == nullptr ? place : job.rows[place], column = number % width;
    step_number(is, of.gradient[row * job.gradient.stride + column],
                of.values[row * job.values.stride + column],
                of.first[row * job.first.stride + column],
                of.second[row * job.second.stride + column]);
  }
}

}  // namespace cuda
}  // namespace gsfw
