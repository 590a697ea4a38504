#include "sort.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "pool.h"
#include "stages.h"

namespace gsfw {
namespace {

constexpr int DIGIT_BITS = 11;
constexpr int DIGITS = 1 << DIGIT_BITS;

// The bits of positive floating-point numbers are ordered as the numbers are.
uint32_t key_of(float depth) {
  uint32_t bits;
  std::memcpy(&bits, &depth, sizeof(bits));
  return bits;
}

uint64_t key_of(double depth) {
  uint64_t bits;
  std::memcpy(&bits, &depth, sizeof(bits));
  return bits;
}

template <typename Key>
struct Keyed {
  Key* keys;
  uint32_t* rows;
};

/// Gather the keys of visible rows, in the order of rows; returns how many there are.
template <typename T, typename Key>
int64_t gather_keys(const T* depths, const uint8_t* visible, int64_t count, int threads,
                    int64_t* starts, const Keyed<Key>& to) {
  const int64_t tasks = (count + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  parallel_pieces(count, ROWS_PER_TASK, threads, [&](int64_t begin, int64_t end, int) {
    int64_t seen = 0;
    for (int64_t row = begin; row < end; ++row) seen += visible[row];
    starts[begin / ROWS_PER_TASK] = seen;
  });
  int64_t total = 0;
  for (int64_t task = 0; task < tasks; ++task) total += std::exchange(starts[task], total);
  parallel_pieces(count, ROWS_PER_TASK, threads, [&](int64_t begin, int64_t end, int) {
    int64_t at = starts[begin / ROWS_PER_TASK];
    for (int64_t row = begin; row < end; ++row) {
      if (!visible[row]) continue;
      to.keys[at] = key_of(depths[row]);
      to.rows[at++] = static_cast<uint32_t>(row);
    }
  });
  return total;
}

/// One stable pass of a radix sort by the digit at ``shift``; ``counts`` is [pieces, DIGITS].
template <typename Key>
void sort_digit(const Keyed<Key>& from, const Keyed<Key>& to, int64_t count, int shift, int threads,
                int64_t* counts) {
  const int64_t grain = std::max<int64_t>((count + threads - 1) / threads, 1);
  const int64_t pieces = (count + grain - 1) / grain;
  const auto digit = [&](int64_t i) { return from.keys[i] >> shift & (DIGITS - 1); };
  parallel_pieces(count, grain, threads, [&](int64_t begin, int64_t end, int) {
    int64_t* mine = counts + begin / grain * DIGITS;
    std::fill(mine, mine + DIGITS, 0);
    for (int64_t i = begin; i < end; ++i) ++mine[digit(i)];
  });
  int64_t total = 0;
  for (int d = 0; d < DIGITS; ++d) {
    for (int64_t piece = 0; piece < pieces; ++piece) {
      total += std::exchange(counts[piece * DIGITS + d], total);
    }
  }
  parallel_pieces(count, grain, threads, [&](int64_t begin, int64_t end, int) {
    int64_t* next = counts + begin / grain * DIGITS;
    for (int64_t i = begin; i < end; ++i) {
      const int64_t at = next[digit(i)]++;
      to.keys[at] = from.keys[i];
      to.rows[at] = from.rows[i];
    }
  });
}

}  // namespace

template <typename T>
int64_t sort_by_depth(const T* depths, const uint8_t* visible, int64_t count, int threads,
                      SortMemory& memory, uint32_t* order) {
  using Key = decltype(key_of(T()));
  const int64_t tasks = (count + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  int64_t* counts = memory.counts.reserve(std::max<int64_t>(tasks, int64_t(threads) * DIGITS));
  Keyed<Key> from{reinterpret_cast<Key*>(memory.keys[0].reserve(count)), order};
  Keyed<Key> to{reinterpret_cast<Key*>(memory.keys[1].reserve(count)), memory.rows.reserve(count)};
  const int64_t total = gather_keys(depths, visible, count, threads, counts, from);
  // Threads pay off from some thousands of keys on.
  const int workers = total < 8192 ? 1 : threads;
  for (int shift = 0; shift < static_cast<int>(sizeof(Key)) * 8; shift += DIGIT_BITS) {
    sort_digit(from, to, total, shift, workers, counts);
    std::swap(from, to);
  }
  if (from.rows != order) std::memcpy(order, from.rows, total * sizeof(uint32_t));
  return total;
}

template int64_t sort_by_depth(const float*, const uint8_t*, int64_t, int, SortMemory&, uint32_t*);
template int64_t sort_by_depth(const double*, const uint8_t*, int64_t, int, SortMemory&, uint32_t*);

}  // namespace gsfw
