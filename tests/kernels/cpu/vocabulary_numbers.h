// Random numbers in packs, and the comparison of packs with single numbers.
#pragma once

#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <random>

#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

// Inside the set's namespace, so that `fma` is the vocabulary's and not the C library's.
namespace {

int failures = 0;

void fail(const char* what, int lane, double found, double expected) {
  if (++failures > 20) return;
  std::printf("%s, lane %d: found %.9g, expected %.9g\n", what, lane, found, expected);
}

std::mt19937 random_bits(1);

/// The same number, signs of zeros included, or both not a number.
template <typename T>
bool same(T a, T b) {
  return std::memcmp(&a, &b, sizeof(T)) == 0 || (std::isnan(a) && std::isnan(b));
}

template <typename T>
T uniform(T low, T high) {
  return std::uniform_real_distribution<T>(low, high)(random_bits);
}

/// A number of ordinary size, of any size at all, or at the edge of what T holds.
template <typename T>
T any_number() {
  using Limits = std::numeric_limits<T>;
  constexpr T EDGES[] = {T(0), T(0.5), T(1), T(1.5), T(2), Limits::min(), Limits::denorm_min(),
                         Limits::max(), Limits::infinity(), Limits::quiet_NaN(), Limits::epsilon()};
  const T sign = random_bits() % 2 ? T(1) : T(-1);
  switch (random_bits() % 3) {
    case 0: return sign * EDGES[random_bits() % (sizeof(EDGES) / sizeof(T))];
    case 1: return uniform(T(-10), T(10));
    default:
      return sign * std::ldexp(uniform(T(0.5), T(1)),
                               int(random_bits() % unsigned(2 * Limits::max_exponent + 20)) -
                                   Limits::max_exponent - 20);
  }
}

/// Sixteen numbers, as lanes and as a pack.
template <typename T>
struct Numbers {
  T lane[LANES];

  template <typename F>
  explicit Numbers(F make) {
    for (T& x : lane) x = make();
  }
  explicit Numbers(const Pack<T>& pack) { store(lane, pack); }

  Pack<T> pack() const { return load(lane); }
};

constexpr int ROUNDS = 2000;

/// Compare what ``of_packs`` gives for packs with what ``of_numbers`` gives for each lane; results
/// may differ by ``ulps`` in the last place.
template <typename T, typename F, typename G>
void check(const char* what, F of_packs, G of_numbers, double ulps = 0.0) {
  for (int round = 0; round < ROUNDS; ++round) {
    const Numbers<T> a(any_number<T>), b(any_number<T>), c(any_number<T>);
    const Numbers<T> found(of_packs(a.pack(), b.pack(), c.pack()));
    for (int i = 0; i < LANES; ++i) {
      const T expected = of_numbers(a.lane[i], b.lane[i], c.lane[i]);
      const T slack = T(ulps) * std::numeric_limits<T>::epsilon() * std::abs(expected);
      if (same(found.lane[i], expected) || std::abs(found.lane[i] - expected) <= slack) continue;
      fail(what, i, found.lane[i], expected);
    }
  }
}

/// ``check`` for what is written alike for packs and numbers.
template <typename T, typename F>
void check(const char* what, F f) {
  check<T>(what, f, f);
}

}  // namespace
}  // namespace GSFW_ISA
}  // namespace gsfw
