// One step of Adam for many tensors, in one pass over memory (Kingma and Ba 2015, algorithm 1).
//
// As gsfw.core.operators has it. Whether the step counts, and how many there were, is read where it
// lies, so that the host waits for nothing.
#include "step_stages.h"

namespace gsfw {
namespace cuda {

/// See ``AdamJob``. One warp; it is a kernel of its own because every block of the other must see
/// the same counts.
template <class T>
__global__ void __launch_bounds__(WARP) begin_adam(AdamJob job) {
  const int index = threadIdx.x;
  if (index >= job.count || *job.finite == 0) return;
  const AdamTable& table = job.tables[index];
  const double steps = *table.steps + 1.0;
  *table.steps = steps;
  T* scales = static_cast<T*>(job.scales) + 2 * index;
  const double rate = table.rate_at ? *table.rate_at : table.rate;
  scales[0] = T(rate / (1.0 - GSFW_ELEMENTARY(pow)(job.beta1, steps)));
  scales[1] = T(1.0 / (1.0 - GSFW_ELEMENTARY(pow)(job.beta2, steps)));
}

/// Constants of a table's step as T.
template <class T>
struct AdamConstants {
  T weight1, decay2, weight2, epsilon, limit, rate, correction2;

  __device__ __forceinline__ AdamConstants(const AdamJob& job, int table)
      : weight1(T(1.0 - job.beta1)),
        decay2(T(job.beta2)),
        weight2(T(1.0 - job.beta2)),
        epsilon(T(job.epsilon)),
        limit(T(job.gradient_limit)),
        rate(static_cast<const T*>(job.scales)[2 * table]),
        correction2(static_cast<const T*>(job.scales)[2 * table + 1]) {}
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

/// First elements of the arrays of a table.
template <class T>
struct AdamArrays {
  T *values, *first, *second;
  const T* gradient;

  __device__ __forceinline__ explicit AdamArrays(const AdamTable& table)
      : values(static_cast<T*>(table.values.numbers)),
        first(static_cast<T*>(table.first.numbers)),
        second(static_cast<T*>(table.second.numbers)),
        gradient(static_cast<const T*>(table.gradient.numbers)) {}
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

/// All rows, which follow one another without gaps. Every thread steps ADAM_NUMBERS numbers next to
/// one another. ``block`` counts the blocks of the table.
template <class T>
__device__ __forceinline__ void step_whole(const AdamConstants<T>& is, const AdamTable& table,
                                           int64 block) {
  const AdamArrays<T> of(table);
  const int64 end = table.count * table.width;
  const int64 from = (block * ADAM_THREADS + int(threadIdx.x)) * ADAM_NUMBERS;
  if (table.aligned && from + ADAM_NUMBERS <= end) return step_quad(is, of, from);
  for (int64 i = from; i < end && i < from + ADAM_NUMBERS; ++i) {
    step_number(is, of.gradient[i], of.values[i], of.first[i], of.second[i]);
  }
}

/// Rows that lie apart, or some rows of all. Neighbouring threads step numbers next to each other,
/// ADAM_NUMBERS times over.
template <class T>
__device__ __forceinline__ void step_rows(const AdamConstants<T>& is, const AdamTable& table,
                                          int64 block) {
  const AdamArrays<T> of(table);
  const int64 from = block * (ADAM_THREADS * ADAM_NUMBERS), first_place = from / table.width;
  const uint32 width = uint32(table.width), before = uint32(from - first_place * table.width);
#pragma unroll
  for (int i = 0; i < ADAM_NUMBERS; ++i) {
    // Within a block 32 bits suffice, which divide much faster.
    const uint32 number = before + uint32(i * ADAM_THREADS) + threadIdx.x;
    const int64 place = first_place + number / width;
    if (place >= table.count) return;
    const int64 row = table.rows == nullptr ? place : table.rows[place], column = number % width;
    step_number(is, of.gradient[row * table.gradient.stride + column],
                of.values[row * table.values.stride + column],
                of.first[row * table.first.stride + column],
                of.second[row * table.second.stride + column]);
  }
}

/// See ``AdamJob``. Every block has ADAM_THREADS and steps ADAM_THREADS * ADAM_NUMBERS numbers of
/// one table, or those that are left of it.
template <class T>
__global__ void __launch_bounds__(ADAM_THREADS) adam(AdamJob job) {
  if (*job.finite == 0) return;
  int index = 0;
  while (index + 1 < job.count && int(blockIdx.x) >= job.tables[index + 1].first_block) ++index;
  const AdamTable& table = job.tables[index];
  const AdamConstants<T> is(job, index);
  const int64 block = int(blockIdx.x) - table.first_block;
  if (table.whole) {
    step_whole(is, table, block);
  } else {
    step_rows(is, table, block);
  }
}

}  // namespace cuda
}  // namespace gsfw
