// Checks of what reads and writes memory: at the edge of what may be touched, and nothing beside.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstdio>
#include <vector>

#include "vocabulary_numbers.h"

namespace gsfw {
namespace GSFW_ISA {
namespace {

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

}  // namespace
}  // namespace GSFW_ISA
}  // namespace gsfw
