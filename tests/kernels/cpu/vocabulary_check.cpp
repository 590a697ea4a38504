// Checks that the packs of one instruction set mean what single numbers mean.
//
// Compile it for a set with the definitions and flags that kernels/cpu/native/CMakeLists.txt has
// for that set's kernels, and run it. It prints what differs and exits with 1, or exits with 0.
#include <cmath>
#include <cstdio>

#include "vocabulary_memory.h"
#include "vocabulary_numbers.h"

namespace gsfw {
namespace GSFW_ISA {
namespace {

template <typename T>
void check_arithmetic() {
  check<T>("+", [](auto a, auto b, auto) { return a + b; });
  check<T>("-", [](auto a, auto b, auto) { return a - b; });
  check<T>("*", [](auto a, auto b, auto) { return a * b; });
  check<T>("/", [](auto a, auto b, auto) { return a / b; });
  check<T>("negative", [](auto a, auto, auto) { return -a; });
  check<T>("fma", [](auto a, auto b, auto c) { return fma(a, b, c); });
  check<T>("fma_negated", [](auto a, auto b, auto c) { return fma_negated(a, b, c); },
           [](T a, T b, T c) { return fma(-a, b, c); });
  check<T>("from a number", [](auto, auto, auto) { return Pack<T>(0.1); },
           [](T, T, T) { return T(0.1); });
  check<T>("minimum", [](auto a, auto b, auto) { return minimum(a, b); });
  check<T>("maximum", [](auto a, auto b, auto) { return maximum(a, b); });
  check<T>("absolute", [](auto a, auto, auto) { return absolute(a); });
  check<T>("square_root", [](auto a, auto, auto) { return square_root(a); });
  check<T>("round_down", [](auto a, auto, auto) { return round_down(a); });
  check<T>("arc_tangent", [](auto a, auto, auto) { return arc_tangent(a); });
  check<T>("logarithm_of_two", [](auto a, auto, auto) { return logarithm_of_two(a); },
           [](T a, T, T) { return std::log2(a); }, 2.0);
}

template <typename T>
void check_masks() {
  check<T>("select <", [](auto a, auto b, auto c) { return select(a < b, b, c); });
  check<T>("select <=", [](auto a, auto b, auto c) { return select(a <= b, b, c); });
  check<T>("select >", [](auto a, auto b, auto c) { return select(a > b, b, c); });
  check<T>("select >=", [](auto a, auto b, auto c) { return select(a >= b, b, c); });
  check<T>("equal", [](auto a, auto b, auto c) { return select((a <= b) & (a >= b), a, c); });
  check<T>("unequal", [](auto a, auto b, auto c) { return select((a < b) | (a > b), a, c); });
  check<T>("not", [](auto a, auto b, auto c) { return select(!(a < b), a, c); });
  check<T>("keep", [](auto a, auto b, auto) { return keep(a < b, a); },
           [](T a, T b, T) { return a < b ? a : T(0); });
  const Pack<T> one(1.0), two(2.0);
  for (uint32_t bits = 0; bits < 1u << LANES; ++bits) {
    const LaneMask<T> mask = lanes_of<T>(bits);
    if (bits_of(mask) != bits) fail("bits_of", -1, bits_of(mask), bits);
    if (bits_of(!mask) != (~bits & 0xffffu)) fail("bits_of not", -1, bits_of(!mask), bits);
    if (any(mask) != (bits != 0)) fail("any", -1, any(mask), bits);
    const uint32_t selected = bits_of(select(mask, one, two) < two);
    if (selected != bits) fail("select lanes_of", -1, selected, bits);
  }
  for (const int64_t count : {0, 1, 2, 3, 4, 5, 7, 8, 9, 11, 12, 13, 15, 16, 17, 100}) {
    const uint32_t expected = count >= LANES ? 0xffffu : (1u << count) - 1u;
    const uint32_t found = bits_of(first_lanes<T>(count));
    if (found != expected) fail("first_lanes", int(count), found, expected);
  }
  const uint32_t all = bits_of(first_lanes<T>(int64_t(1) << 40));
  if (all != 0xffffu) fail("first_lanes of very many", -1, all, 0xffff);
}

template <typename T>
void check_sums() {
  for (int round = 0; round < ROUNDS; ++round) {
    Pack<T> packs[8];
    double expected[8], slack[8];
    for (int p = 0; p < 8; ++p) {
      const Numbers<T> numbers([] { return uniform(T(-10), T(10)); });
      packs[p] = numbers.pack();
      expected[p] = slack[p] = 0.0;
      for (const T x : numbers.lane) {
        expected[p] += double(x);
        slack[p] += 4.0 * std::numeric_limits<T>::epsilon() * std::abs(double(x));
      }
    }
    T found[8];
    sum_eight(packs, found);
    for (int p = 0; p < 8; ++p) {
      const T single = sum(packs[p]);
      if (!(std::abs(found[p] - expected[p]) <= slack[p])) {
        fail("sum_eight", p, found[p], expected[p]);
      }
      if (!(std::abs(single - expected[p]) <= slack[p])) fail("sum", p, single, expected[p]);
    }
  }
}

/// What ``f`` gives for the parts of three packs, joined.
template <typename T, typename F>
Pack<T> by_parts(const Pack<T>& a, const Pack<T>& b, const Pack<T>& c, F f) {
  const Numbers<T> first(a), second(b), third(c);
  T joined[LANES];
  for (int i = 0; i < LANES; i += PART_LANES<T>) {
    store(joined + i, f(load_part(first.lane + i), load_part(second.lane + i),
                        load_part(third.lane + i)));
  }
  return load(joined);
}

template <typename T>
void check_parts() {
  const auto compare = [](const char* what, auto f, auto of_numbers) {
    check<T>(what, [f](auto a, auto b, auto c) { return by_parts<T>(a, b, c, f); }, of_numbers);
  };
  const auto alike = [compare](const char* what, auto f) { compare(what, f, f); };
  alike("+ of parts", [](auto a, auto b, auto) { return a + b; });
  alike("- of parts", [](auto a, auto b, auto) { return a - b; });
  alike("* of parts", [](auto a, auto b, auto) { return a * b; });
  alike("fma of parts", [](auto a, auto b, auto c) { return fma(a, b, c); });
  alike("absolute of parts", [](auto a, auto, auto) { return absolute(a); });
  compare("keep of parts", [](auto a, auto b, auto) { return keep(a <= b, a); },
          [](T a, T b, T) { return a <= b ? a : T(0); });
  Part<T> parts[8];
  for (int p = 0; p < 8; ++p) {
    int i = 0;
    const Numbers<T> numbers([&] { return T(p + 3 * i++); });
    parts[p] = load_part(numbers.lane);
    T expected = 0;
    for (int k = 0; k < PART_LANES<T>; ++k) expected += numbers.lane[k];
    if (sum(parts[p]) != expected) fail("sum of a part", p, sum(parts[p]), expected);
  }
  T found[8];
  sum_eight(parts, found);
  for (int p = 0; p < 8; ++p) {
    if (found[p] != sum(parts[p])) fail("sum_eight of parts", p, found[p], sum(parts[p]));
  }
}

/// Relative error of a power of two: its polynomial's, and more where each product is rounded.
constexpr double POWER_ERROR = GSFW_FUSES ? 2.2e-7 : 2.6e-7;

/// Right where 2^x is a normal number; under that nothing, or next to nothing.
void check_power_of_two() {
  constexpr float STEP = 253.0f / (1 << 20);
  float next = -126.0f;
  while (next < 127.0f - LANES * STEP) {
    const Numbers<float> x([&] { return next += STEP; });
    const Numbers<float> found(power_of_two(x.pack()));
    for (int i = 0; i < LANES; ++i) {
      const double expected = std::exp2(double(x.lane[i]));
      if (std::abs(found.lane[i] / expected - 1.0) <= POWER_ERROR) continue;
      fail("power_of_two", i, found.lane[i], expected);
    }
  }
  for (const float x : {-126.001f, -126.5f, -127.0f, -149.0f, -1e3f, -1e10f, -3e38f, -INFINITY}) {
    const Numbers<float> found(power_of_two(Pack<float>(x)));
    for (int i = 0; i < LANES; ++i) {
      if (found.lane[i] >= 0.0f && found.lane[i] <= 1.01f * 1.2e-38f) continue;
      fail("power_of_two far down", i, found.lane[i], 0.0);
    }
  }
}

template <typename T>
void check_transpose() {
  Pack<T> packs[LANES];
  for (int k = 0; k < LANES; ++k) {
    int i = 0;
    packs[k] = Numbers<T>([&] { return T(k * LANES + i++); }).pack();
  }
  transpose(packs);
  for (int i = 0; i < LANES; ++i) {
    const Numbers<T> found(packs[i]);
    for (int k = 0; k < LANES; ++k) {
      if (found.lane[k] != T(k * LANES + i)) fail("transpose", k, found.lane[k], k * LANES + i);
    }
  }
}

template <typename T>
void check_type() {
  check_arithmetic<T>();
  check_masks<T>();
  check_sums<T>();
  check_parts<T>();
  check_loads<T>();
  check_strided_stores<T>();
  check_rows<T, 3>();
  check_rows<T, 4>();
  check_transpose<T>();
  check_bit_ranges<T>();
}

}  // namespace

int check_vocabulary() {
  check_type<float>();
  check_type<double>();
  check_power_of_two();
  check_split_by_bit();
  check_keep_nonzero();
  if (failures) std::printf("%d differences in all\n", failures);
  return failures ? 1 : 0;
}

}  // namespace GSFW_ISA
}  // namespace gsfw

int main() { return gsfw::GSFW_ISA::check_vocabulary(); }
