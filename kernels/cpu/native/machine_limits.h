// Limits: what one thread of this machine can do at most, in the words that blending is written in.
//
// `gsfw bench` sets the time of blending against these. Each figure is measured with the packs of
// one instruction set, so that it is the limit of that set and not of the machine's best.
#pragma once

#include <time.h>

#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// CPU time of this thread in seconds, so that waiting for a core does not count; of the process
/// where the system does not tell threads apart.
inline double thread_seconds() {
#ifdef CLOCK_THREAD_CPUTIME_ID
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
#else
  return double(clock()) / CLOCKS_PER_SEC;
#endif
}

/// Registers that one pack of sixteen float32 takes.
#if defined(GSFW_SIMD_avx512)
constexpr int PACK_REGISTERS = 1;
#elif defined(GSFW_SIMD_avx2)
constexpr int PACK_REGISTERS = 2;
#else
constexpr int PACK_REGISTERS = 4;
#endif

/// Chains of dependent operations, 12 registers in all: enough to hide a latency of 4 cycles with 3
/// operations per cycle, and few enough for 16 registers to hold.
constexpr int CHAINS = 12 / PACK_REGISTERS;

/// Turns of the loop between two looks at the clock: some tens of microseconds.
constexpr int TURNS = 16384;

/// Fused multiply-adds of float32 in 1e9 operations per second, two for each; plain multiplications
/// and additions where the set has no fused ones. Takes ``seconds``.
inline double fma_gflops(double seconds) {
  // Every chain goes to 1, so that no number is ever denormal or infinite.
  const Pack<float> factor(0.999), term(0.001);
  Pack<float> chains[CHAINS];
  for (int i = 0; i < CHAINS; ++i) chains[i] = Pack<float>(double(i));
  const double start = thread_seconds();
  double elapsed = 0.0, turns = 0.0;
  while (elapsed < seconds) {
    for (int k = 0; k < TURNS; ++k) {
      for (int i = 0; i < CHAINS; ++i) chains[i] = fma(chains[i], factor, term);
    }
    turns += TURNS;
    elapsed = thread_seconds() - start;
  }
  Pack<float> all(0.0);
  for (int i = 0; i < CHAINS; ++i) all = all + chains[i];
  volatile float used = sum(all);
  (void)used;
  return 2e-9 * turns * CHAINS * LANES / elapsed;
}

/// Powers of two of float32 in 1e9 per second, each added to a sum. Takes ``seconds``.
inline double exponential_gexp(double seconds) {
  // Levels of alpha as blending has them, from memory so that none is worked out only once.
  constexpr int LEVELS = 1024;
  alignas(64) float levels[LEVELS];
  for (int i = 0; i < LEVELS; ++i) levels[i] = float(i) * (-8.0f / LEVELS);
  Pack<float> sums[2] = {Pack<float>(0.0), Pack<float>(0.0)};
  const double start = thread_seconds();
  double elapsed = 0.0, count = 0.0;
  while (elapsed < seconds) {
    for (int k = 0; k < TURNS; k += LEVELS / LANES) {
      for (int i = 0; i < LEVELS; i += 2 * LANES) {
        for (int j = 0; j < 2; ++j) {
          sums[j] = sums[j] + power_of_two(load(levels + i + j * LANES));
        }
      }
    }
    count += double(TURNS) * LANES;
    elapsed = thread_seconds() - start;
  }
  volatile float used = sum(sums[0] + sums[1]);
  (void)used;
  return 1e-9 * count / elapsed;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
