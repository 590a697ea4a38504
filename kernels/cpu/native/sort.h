// Sort: visible rows from front to back, equal depths by row, the same for any number of threads.
#pragma once

#include <cstdint>

#include "memory.h"

namespace gsfw {

/// Working memory of ``sort_by_depth``.
struct SortMemory {
  Buffer<uint64_t> keys[2];
  Buffer<uint32_t> rows;
  Buffer<int64_t> counts;
};

/// Write the visible ones of ``count`` rows to ``order``, which has room for all; depths are
/// positive. Returns how many there are.
template <typename T>
int64_t sort_by_depth(const T* depths, const uint8_t* visible, int64_t count, int threads,
                      SortMemory& memory, uint32_t* order);

}  // namespace gsfw
