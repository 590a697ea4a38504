// Arrays: the job of every kernel that tests the emulation.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

constexpr int ARRAY_THREADS = 128;

struct ArrayJob {
  int64 count;
  const void* input;
  void* output;
};

template <class T>
__device__ __forceinline__ T read(const ArrayJob& job, int64 index) {
  return static_cast<const T*>(job.input)[index];
}
template <class T>
__device__ __forceinline__ T& written(const ArrayJob& job, int64 index) {
  return static_cast<T*>(job.output)[index];
}

}  // namespace cuda
}  // namespace gsfw
