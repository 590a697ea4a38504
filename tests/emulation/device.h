// Device: the part of CUDA C++ that kernels use, for a C++ compiler; one thread is one fiber.
//
// Light, since it is compiled with every instance of every kernel: what runs the fibers is a
// library, runtime.cpp.
#pragma once

#include "thread.h"
#include "vector_types.h"

#define __global__
#define __device__
#define __forceinline__ inline
#define __noinline__ __attribute__((noinline))
#define __launch_bounds__(...)
#define __align__(bytes) __attribute__((aligned(bytes)))
#ifdef __SANITIZE_ADDRESS__
// It does not watch what every thread of the system has for itself.
#define __shared__ static
#else
#define __shared__ static thread_local
#endif

#define threadIdx (::emulation::current->index)
#define blockIdx (::emulation::current->block->index)
#define blockDim (::emulation::current->block->size)
#define gridDim (::emulation::current->block->blocks)

namespace emulation {

/// Emulated collectives are of whole warps.
inline void need_full(unsigned mask) {
  if (mask != 0xffffffffu) fail("a collective has another mask than that of the full warp");
}

template <class To, class From>
inline To bits_as(From value) {
  static_assert(sizeof(To) == sizeof(From));
  return __builtin_bit_cast(To, value);
}

/// The value that ``source`` brought to this collective; one's own where that is no lane.
template <class N>
inline N exchange(unsigned mask, N value, int source, const char* operation) {
  static_assert(sizeof(N) <= 8, "CUDA exchanges numbers of up to 8 bytes");
  need_full(mask);
  const Thread& self = *current;
  auto& slots = self.warp->slots[self.warp->turn];
  __builtin_memcpy(&slots[self.lane], &value, sizeof(N));
  meet_warp(operation);
  if (source >= 0 && source < WARP_SIZE) __builtin_memcpy(&value, &slots[source], sizeof(N));
  return value;
}

/// The lanes where ``predicate`` is true.
inline unsigned vote(unsigned mask, bool predicate, const char* operation) {
  need_full(mask);
  const Thread& self = *current;
  unsigned& votes = self.warp->votes[self.warp->turn];
  votes |= unsigned(predicate) << self.lane;
  meet_warp(operation);
  return votes;
}

/// How many threads of the block have a true ``predicate``.
inline int count_block(bool predicate, const char* operation) {
  Block& block = *current->block;
  int& count = block.counts[block.turn];
  count += predicate;
  meet_block(operation);
  return count;
}

/// Changes ``*address`` in one step, and returns what was there.
template <class N, class Change>
inline N atomically(N* address, Change change) {
  N old, changed;
  __atomic_load(address, &old, __ATOMIC_RELAXED);
  do {
    changed = change(old);
  } while (!__atomic_compare_exchange(address, &old, &changed, true, __ATOMIC_RELAXED,
                                      __ATOMIC_RELAXED));
  return old;
}

/// Lets ``f(float*, 1)`` compile as it does in CUDA.
template <class N>
struct Same {
  using Type = N;
};

}  // namespace emulation

inline void __syncthreads() { emulation::meet_block("__syncthreads"); }
inline int __syncthreads_count(int predicate) {
  return emulation::count_block(predicate != 0, "__syncthreads_count");
}
inline int __syncthreads_or(int predicate) {
  return emulation::count_block(predicate != 0, "__syncthreads_or") != 0;
}
inline int __syncthreads_and(int predicate) {
  return emulation::count_block(predicate == 0, "__syncthreads_and") == 0;
}

inline void __syncwarp(unsigned mask = 0xffffffffu) {
  emulation::need_full(mask);
  emulation::meet_warp("__syncwarp");
}
// A warp is not divided: there is no ``width``.
template <class N>
inline N __shfl_sync(unsigned mask, N value, int source) {
  return emulation::exchange(mask, value, source & 31, "__shfl_sync");
}
template <class N>
inline N __shfl_up_sync(unsigned mask, N value, unsigned delta) {
  const int source = int(emulation::current->lane) - int(delta);
  return emulation::exchange(mask, value, source, "__shfl_up_sync");
}
template <class N>
inline N __shfl_down_sync(unsigned mask, N value, unsigned delta) {
  const int source = int(emulation::current->lane + delta);
  return emulation::exchange(mask, value, source, "__shfl_down_sync");
}
template <class N>
inline N __shfl_xor_sync(unsigned mask, N value, int lanes) {
  const int source = int(emulation::current->lane) ^ lanes;
  return emulation::exchange(mask, value, source, "__shfl_xor_sync");
}
inline unsigned __ballot_sync(unsigned mask, int predicate) {
  return emulation::vote(mask, predicate != 0, "__ballot_sync");
}
inline int __any_sync(unsigned mask, int predicate) {
  return emulation::vote(mask, predicate != 0, "__any_sync") != 0;
}
inline int __all_sync(unsigned mask, int predicate) {
  return emulation::vote(mask, predicate == 0, "__all_sync") == 0;
}

inline int __popc(unsigned x) { return __builtin_popcount(x); }
inline int __ffs(int x) { return __builtin_ffs(x); }
inline int __clz(int x) { return x == 0 ? 32 : __builtin_clz(unsigned(x)); }
inline unsigned __brev(unsigned x) {
  unsigned reversed = 0;
  for (int bit = 0; bit < 32; ++bit) reversed |= (x >> bit & 1u) << (31 - bit);
  return reversed;
}

inline unsigned __float_as_uint(float x) { return emulation::bits_as<unsigned>(x); }
inline long long __double_as_longlong(double x) { return emulation::bits_as<long long>(x); }

#define EMULATION_LESSER_AND_GREATER(type)                     \
  inline type min(type a, type b) { return b < a ? b : a; }    \
  inline type max(type a, type b) { return a < b ? b : a; }
EMULATION_LESSER_AND_GREATER(int)
EMULATION_LESSER_AND_GREATER(unsigned)
EMULATION_LESSER_AND_GREATER(long long)
EMULATION_LESSER_AND_GREATER(unsigned long long)
#undef EMULATION_LESSER_AND_GREATER
// Of a number and a NaN, CUDA takes the number.
inline float min(float a, float b) { return __builtin_fminf(a, b); }
inline float max(float a, float b) { return __builtin_fmaxf(a, b); }
inline double min(double a, double b) { return __builtin_fmin(a, b); }
inline double max(double a, double b) { return __builtin_fmax(a, b); }

#define EMULATION_ATOMIC(name, changed)                                                  \
  template <class N>                                                                     \
  inline N name(N* address, typename emulation::Same<N>::Type value) {                   \
    return emulation::atomically(address, [value](N old) -> N { return changed; });      \
  }
EMULATION_ATOMIC(atomicAdd, old + value)
EMULATION_ATOMIC(atomicMin, min(old, value))
EMULATION_ATOMIC(atomicMax, max(old, value))
EMULATION_ATOMIC(atomicAnd, old& value)
EMULATION_ATOMIC(atomicOr, old | value)
EMULATION_ATOMIC(atomicXor, old ^ value)
EMULATION_ATOMIC(atomicExch, value)
#undef EMULATION_ATOMIC
template <class N>
inline N atomicCAS(N* address, typename emulation::Same<N>::Type expected,
                   typename emulation::Same<N>::Type value) {
  return emulation::atomically(address,
                               [=](N old) -> N { return old == expected ? value : old; });
}
