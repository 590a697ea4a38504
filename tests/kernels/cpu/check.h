// Shared parts of the checks: complaints, and random numbers that float32 and float64 both hold.
#pragma once

#include <cstdint>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

namespace gsfw {

inline int failures = 0;

inline void fail(const std::string& what) {
  ++failures;
  std::printf("%s\n", what.c_str());
}

/// ``size`` numbers between ``low`` and ``high``, the same in float and double.
template <typename T>
std::vector<T> uniform(int64_t size, unsigned seed, double low = 0.0, double high = 1.0) {
  std::mt19937 bits(seed);
  std::vector<T> numbers(static_cast<size_t>(size));
  for (T& x : numbers) {
    x = T(float(low + (high - low) * double(bits()) / double(std::mt19937::max())));
  }
  return numbers;
}

}  // namespace gsfw
