// Arguments of the kernels that sort, mirrored field by field in
// kernels/cuda/sort.py.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

/// Values that a digit can have at most.
constexpr int DIGITS = 256;
/// Threads of a block.
constexpr int SORT_THREADS = 512;
/// Keys of each thread: as many as shared memory has room to put in order.
template <class Key>
constexpr int KEYS_PER_THREAD = sizeof(Key) > 4 ? 4 : 8;

/// Most digits of a key.
constexpr int SORT_PASSES = 8;
/// Most blocks of ``count_digits``, each of which adds its counts to those of all.
constexpr int COUNT_BLOCKS = 512;

/// The digit that one pass sorts by: ``digits`` values, a power of two, from bit ``shift`` on.
struct DigitField {
  int shift, digits;
};

/// count_digits<Key>: how often each digit of each pass occurs.
struct DigitsJob {
  /// Key [n]
  const void* keys;
  int64 count;
  /// See ``count_of``.
  const int64* counted;
  DigitField fields[SORT_PASSES];
  int passes;
  int unused;
  /// [passes, DIGITS]; 0 before the kernel.
  uint64* counts;
};

/// scatter<Key>: to its place with every key, and with what goes along with it.
struct ScatterJob {
  /// Key [n]
  const void* keys;
  /// int32 [n]; null where it is the index of the key.
  const int* payload;
  int64 count;
  /// See ``count_of``.
  const int64* counted;
  DigitField field;
  /// Number of the pass.
  int pass;
  int unused;
  /// [DIGITS]: how often each digit occurs.
  const uint64* counts;
  /// The number that the next block of this pass takes; 0 before the kernel.
  uint64* next;
  /// [blocks, DIGITS]: sums of blocks; 0 before the first pass.
  uint64* words;
  /// Key [n] and int32 [n]
  void* sorted_keys;
  int* sorted_payload;
};

}  // namespace cuda
}  // namespace gsfw
