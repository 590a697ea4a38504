// Checks that the packs of one instruction set mean what single numbers mean.
//
// Compile it for a set with the definitions and flags that kernels/cpu/native/CMakeLists.txt has
// for that set's kernels, and run it. It prints what differs and exits with 1, or exits with 0.
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

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

/// Memory between two pages that stop the program when they are touched.
template <typename T>
class Fenced {
 public:
  Fenced() {
    const size_t page = size_t(sysconf(_SC_PAGESIZE)), inside = (BYTES + page - 1) / page * page;
    void* all = mmap(nullptr, inside + 2 * page, PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (all == MAP_FAILED) std::perror("mmap"), _exit(1);
    char* bytes = static_cast<char*>(all);
    mprotect(bytes, page, PROT_NONE);
    mprotect(bytes + page + inside, page, PROT_NONE);
    begin = reinterpret_cast<T*>(bytes + page);
    end = reinterpret_cast<T*>(bytes + page + inside);
  }

  /// Number the elements from 1 on.
  void number() {
    for (T* at = begin; at < end; ++at) *at = T(at - begin + 1);
  }

  T* begin;
  T* end;

 private:
  static constexpr size_t BYTES = 16384;
};

constexpr int64_t STRIDES[] = {1, 2, 7, 16, 59};

template <typename T>
void check_loads() {
  Fenced<T> memory;
  memory.number();
  for (int64_t count = 0; count <= LANES + 1; ++count) {
    const int64_t lanes = count < LANES ? count : LANES;
    for (const int64_t stride : STRIDES) {
      const T* from = lanes ? memory.end - 1 - (lanes - 1) * stride : memory.end;
      const Numbers<T> found(load_strided(from, stride, count));
      for (int i = 0; i < LANES; ++i) {
        const T expected = i < count ? from[i * stride] : T(0);
        if (!same(found.lane[i], expected)) fail("load_strided", i, found.lane[i], expected);
      }
    }
  }
  const Numbers<T> last(load(memory.end - LANES));
  for (int i = 0; i < LANES; ++i) {
    const T expected = memory.end[i - LANES];
    if (!same(last.lane[i], expected)) fail("load", i, last.lane[i], expected);
  }
}

/// Compare all of ``memory`` with what it should be.
template <typename T>
void compare(const char* what, const Fenced<T>& memory, const std::vector<T>& expected) {
  for (size_t i = 0; i < expected.size(); ++i) {
    if (!same(memory.begin[i], expected[i])) fail(what, int(i), memory.begin[i], expected[i]);
  }
}

template <typename T>
void check_strided_stores() {
  Fenced<T> memory;
  const Numbers<T> numbers(any_number<T>);
  for (int round = 0; round < ROUNDS; ++round) {
    const uint32_t bits = round ? random_bits() & random_bits() & 0xffffu : 0xffffu;
    const int lanes = bits ? 32 - __builtin_clz(bits) : 0;
    const int64_t stride = STRIDES[size_t(round) % (sizeof(STRIDES) / sizeof(int64_t))];
    T* to = lanes ? memory.end - 1 - (lanes - 1) * stride : memory.end;
    memory.number();
    std::vector<T> expected(memory.begin, memory.end);
    for (int i = 0; i < lanes; ++i) {
      if (bits >> i & 1) expected[size_t(to - memory.begin + i * stride)] = numbers.lane[i];
    }
    store_strided(to, stride, lanes_of<T>(bits), numbers.pack());
    compare("store_strided", memory, expected);
  }
}

template <typename T, int FIELDS>
void check_rows() {
  Fenced<T> memory;
  for (int64_t count = 0; count <= LANES; ++count) {
    memory.number();
    T* at = memory.end - count * FIELDS;
    Pack<T> fields[FIELDS];
    load_rows<FIELDS>(at, count, fields);
    std::vector<T> expected(memory.begin, memory.end);
    for (int k = 0; k < FIELDS; ++k) {
      const Numbers<T> found(fields[k]);
      for (int i = 0; i < LANES; ++i) {
        const T number = i < count ? at[i * FIELDS + k] : T(0);
        if (!same(found.lane[i], number)) fail("load_rows", i, found.lane[i], number);
        if (i < count) expected[size_t(at - memory.begin + i * FIELDS + k)] = -number;
      }
      fields[k] = -fields[k];
    }
    store_rows<FIELDS>(at, count, fields);
    compare("store_rows", memory, expected);
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

void check_split_by_bit() {
  Fenced<uint32_t> blocks;
  Fenced<uint16_t> lists;
  for (const int count : {0, 1, 2, 7, 8, 9, 15, 16, 17, 31, 33, 100, 255, 256}) {
    const int capacity = count + LANES;
    uint32_t* from = blocks.end - count;
    uint16_t* to = lists.end - LANES * capacity;
    for (int i = 0; i < count; ++i) from[i] = (random_bits() | random_bits()) & 0xffffu;
    for (int i = 0; i < count; i += 3) from[i] &= random_bits();
    int lengths[LANES];
    split_by_bit(from, count, to, capacity, lengths);
    for (int b = 0; b < LANES; ++b) {
      int length = 0;
      for (int i = 0; i < count; ++i) {
        if (!(from[i] >> b & 1)) continue;
        const int found = to[b * capacity + length++];
        if (found != i) fail("split_by_bit", b, found, i);
      }
      if (lengths[b] != length) fail("length of split_by_bit", b, lengths[b], length);
    }
  }
}

template <typename T>
void check_bit_ranges() {
  Fenced<uint16_t> memory;
  uint16_t* to = memory.end - LANES;
  for (int first = 0; first <= LANES; ++first) {
    int end = first;
    const Numbers<T> ends([&] { return T(end++ % (LANES + 1 - first) + first); });
    bit_ranges(Pack<T>(T(first)), ends.pack(), to);
    for (int i = 0; i < LANES; ++i) {
      int expected = 0;
      for (int b = first; b < int(ends.lane[i]); ++b) expected |= 1 << b;
      if (to[i] != expected) fail("bit_ranges", i, to[i], expected);
    }
  }
}

void check_keep_nonzero() {
  Fenced<uint16_t> numbers, kept;
  Fenced<uint32_t> labels, kept_labels;
  uint16_t *from = numbers.end - LANES, *to = kept.end - LANES;
  uint32_t *names = labels.end - LANES, *to_names = kept_labels.end - LANES;
  for (int round = 0; round < ROUNDS; ++round) {
    const uint32_t there = round ? random_bits() & random_bits() : 0xffffu;
    for (int i = 0; i < LANES; ++i) {
      from[i] = there >> i & 1 ? uint16_t(random_bits() | 1) : 0;
      names[i] = random_bits();
    }
    const uint32_t base = random_bits();
    const int count = keep_nonzero(from, names, base, to, to_names);
    int next = 0;
    for (int i = 0; i < LANES; ++i) {
      if (from[i] == 0) continue;
      if (to[next] != from[i]) fail("keep_nonzero", i, to[next], from[i]);
      if (to_names[next] != names[i] + base) fail("label of keep_nonzero", i, next, i);
      ++next;
    }
    if (count != next) fail("count of keep_nonzero", round, count, next);
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
