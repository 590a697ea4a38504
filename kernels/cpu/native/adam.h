// One step of Adam in one pass over memory (Kingma and Ba 2015, algorithm 1).
//
// Operation for operation as gsfw.core.operators has it. Every number is computed by itself, so how
// they are shared among threads changes nothing.
#pragma once

#include "simd/simd.h"
#include "step_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// ``AdamJob``'s constants in every lane.
template <typename T>
struct AdamConstants {
  Pack<T> weight1, decay2, weight2, bias2, rate, epsilon, limit;

  GSFW_FUNCTION explicit AdamConstants(const AdamJob<T>& job)
      : weight1(job.weight1),
        decay2(job.decay2),
        weight2(job.weight2),
        bias2(job.bias2),
        rate(job.rate),
        epsilon(job.epsilon),
        limit(job.gradient_limit) {}
};

/// Values and moments of sixteen numbers.
template <typename T>
struct AdamPacks {
  Pack<T> value, first, second;
};

template <typename T>
GSFW_FUNCTION AdamPacks<T> adam_packs(const AdamPacks<T>& old, const Pack<T>& gradient,
                                      const AdamConstants<T>& is) {
  const Pack<T> g = maximum(-is.limit, minimum(is.limit, gradient));
  AdamPacks<T> now;
  now.first = fma(is.weight1, g - old.first, old.first);
  now.second = old.second * is.decay2 + is.weight2 * g * g;
  const Pack<T> denominator = square_root(now.second / is.bias2) + is.epsilon;
  now.value = old.value - now.first / denominator * is.rate;
  return now;
}

/// Numbers [0, count) from these addresses on.
template <typename T>
GSFW_FUNCTION void adam_run(const AdamConstants<T>& is, T* value, const T* gradient, T* first,
                            T* second, int64_t count) {
  // Numbers that are asked for early: within a page the processor begins too late by itself.
  constexpr int64_t AHEAD = 2048 / sizeof(T);
  int64_t i = 0;
  for (; i + LANES <= count; i += LANES) {
    if (i + AHEAD < count) {
      __builtin_prefetch(value + i + AHEAD, 1);
      __builtin_prefetch(gradient + i + AHEAD);
      __builtin_prefetch(first + i + AHEAD, 1);
      __builtin_prefetch(second + i + AHEAD, 1);
    }
    const AdamPacks<T> old = {load(value + i), load(first + i), load(second + i)};
    const AdamPacks<T> now = adam_packs(old, load(gradient + i), is);
    store(value + i, now.value);
    store(first + i, now.first);
    store(second + i, now.second);
  }
  const int64_t rest = count - i;
  if (rest == 0) return;
  const LaneMask<T> there = first_lanes<T>(rest);
  const AdamPacks<T> old = {load_strided(value + i, 1, rest), load_strided(first + i, 1, rest),
                            load_strided(second + i, 1, rest)};
  const AdamPacks<T> now = adam_packs(old, load_strided(gradient + i, 1, rest), is);
  store_strided(value + i, 1, there, now.value);
  store_strided(first + i, 1, there, now.first);
  store_strided(second + i, 1, there, now.second);
}

/// Numbers that are gathered from rows before they are stepped together.
constexpr int64_t ADAM_BATCH = 1024;

/// Some rows, next to one another.
template <typename T>
struct AdamBatch {
  T values[ADAM_BATCH], gradient[ADAM_BATCH], first[ADAM_BATCH], second[ADAM_BATCH];
};

/// Copy a row; ``WIDTH`` is 0 where it is known at run time only.
template <int WIDTH, typename T>
GSFW_FUNCTION void copy_row(const T* from, int64_t width, T* to) {
  for (int64_t k = 0; k < (WIDTH ? WIDTH : width); ++k) to[k] = from[k];
}

/// ``adam`` for narrow rows, gathering them first: a pack would hold few of their numbers, and
/// reading one next to another that has just been written in part waits for the write.
template <int WIDTH, typename T>
void adam_rows(const AdamJob<T>& job, int64_t begin, int64_t end) {
  const AdamConstants<T> is(job);
  AdamBatch<T> batch;
  const int64_t width = WIDTH ? WIDTH : job.width, most = ADAM_BATCH / width;
  for (int64_t start = begin; start < end; start += most) {
    const int64_t count = end - start < most ? end - start : most;
    for (int64_t i = 0; i < count; ++i) {
      const int64_t row = job.rows ? job.rows[start + i] : start + i, at = i * width;
      copy_row<WIDTH>(job.values.data + row * job.values.stride, width, batch.values + at);
      copy_row<WIDTH>(job.gradient.data + row * job.gradient.stride, width, batch.gradient + at);
      copy_row<WIDTH>(job.first.data + row * job.first.stride, width, batch.first + at);
      copy_row<WIDTH>(job.second.data + row * job.second.stride, width, batch.second + at);
    }
    adam_run(is, batch.values, batch.gradient, batch.first, batch.second, count * width);
    for (int64_t i = 0; i < count; ++i) {
      const int64_t row = job.rows ? job.rows[start + i] : start + i, at = i * width;
      copy_row<WIDTH>(batch.values + at, width, job.values.data + row * job.values.stride);
      copy_row<WIDTH>(batch.first + at, width, job.first.data + row * job.first.stride);
      copy_row<WIDTH>(batch.second + at, width, job.second.data + row * job.second.stride);
    }
  }
}

/// Step rows [begin, end) of the job's list, or of all rows.
template <typename T>
void adam(const AdamJob<T>& job, int64_t begin, int64_t end) {
  const int64_t width = job.width;
  const bool gapless = job.values.stride == width && job.gradient.stride == width &&
                       job.first.stride == width && job.second.stride == width;
  const bool whole = gapless && job.rows == nullptr;
  if (!whole && width == 1) return adam_rows<1>(job, begin, end);
  if (!whole && width == 3) return adam_rows<3>(job, begin, end);
  if (!whole && width == 4) return adam_rows<4>(job, begin, end);
  if (!whole && width < LANES) return adam_rows<0>(job, begin, end);
  const AdamConstants<T> is(job);
  int64_t count = whole ? end - begin : 1;
  for (int64_t i = begin; i < end; i += count) {
    const int64_t row = job.rows ? job.rows[i] : i;
    if (job.rows && gapless) {  // Neighbours go together.
      for (count = 1; i + count < end && job.rows[i + count] == row + count;) ++count;
    }
    adam_run(is, job.values.data + row * job.values.stride,
             job.gradient.data + row * job.gradient.stride, job.first.data + row * job.first.stride,
             job.second.data + row * job.second.stride, count * width);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
