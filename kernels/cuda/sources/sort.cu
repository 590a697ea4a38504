// Sort: a stable radix sort, least significant digit first, of unsigned keys and a payload.
//
// One kernel counts the digits of all passes. Each pass then takes every key to its place in one
// kernel, whose blocks learn by looking back how many keys of each digit earlier blocks have (Adinets
// and Merrill 2022, "Onesweep"). Within a warp, lanes of one digit find each other by ballots
// (Ashkiani et al. 2016, "GPU Multisplit", section 5); within a block keys are put in order in shared
// memory first, so that they leave it in long runs.
#include "look_back.h"
#include "sort_stages.h"

namespace gsfw {
namespace cuda {

constexpr int SORT_WARPS = SORT_THREADS / WARP;
static_assert(DIGITS <= SORT_THREADS, "each digit has a thread");

template <class Key>
__device__ __forceinline__ int digit_of(Key key, const DigitField& field) {
  return int(key >> field.shift) & (field.digits - 1);
}

/// The first key of a block of keys, among all, and how many it has.
struct KeyBlock {
  int64 first;
  int count;
};

template <class Key>
__device__ __forceinline__ KeyBlock key_block(int64 block, int64 keys) {
  constexpr int MOST = SORT_THREADS * KEYS_PER_THREAD<Key>;
  const int64 first = block * MOST, left = keys - first;
  return {first, left < MOST ? int(left) : MOST};
}

/// Counts the digits of all passes; blocks of threads take turns with the blocks of keys.
template <class Key>
__global__ void __launch_bounds__(SORT_THREADS) count_digits(DigitsJob job) {
  constexpr int PASSES = int(sizeof(Key));
  __shared__ int counts[PASSES * DIGITS];
  for (int i = threadIdx.x; i < PASSES * DIGITS; i += SORT_THREADS) counts[i] = 0;
  __syncthreads();
  const int64 stride = int64(gridDim.x) * SORT_THREADS, count = count_of(job);
  for (int64 i = thread_index(); i < count; i += stride) {
    const Key key = static_cast<const Key*>(job.keys)[i];
#pragma unroll
    for (int pass = 0; pass < PASSES; ++pass) {
      if (pass >= job.passes) break;
      atomicAdd(&counts[pass * DIGITS + digit_of(key, job.fields[pass])], 1);
    }
  }
  __syncthreads();
  for (int i = threadIdx.x; i < job.passes * DIGITS; i += SORT_THREADS) {
    if (counts[i] != 0) atomicAdd(&job.counts[i], uint64(counts[i]));
  }
}

/// The lanes, among those that are ``valid``, whose digit is this lane's. A warp collective.
__device__ __forceinline__ uint32 lanes_alike(int digit, bool valid, int digits) {
  uint32 alike = __ballot_sync(FULL_WARP, valid);
#pragma unroll
  for (int bit = 1; bit < DIGITS; bit *= 2) {
    // To leave the loop here would take more registers.
    if (bit >= digits) continue;
    const bool set = (digit & bit) != 0;
    const uint32 lanes = __ballot_sync(FULL_WARP, set);
    alike &= set ? lanes : ~lanes;
  }
  return alike;
}

/// Number of earlier keys of the warp with its digit; counts it. ``counts`` are the warp's.
/// A warp collective.
__device__ __forceinline__ int rank_in_warp(int digit, bool valid, int digits, int* counts) {
  const uint32 alike = lanes_alike(digit, valid, digits);
  const int before = counts[digit];
  __syncwarp();
  const bool last = valid && (alike >> lane_index()) == 1u;
  if (last) counts[digit] = before + __popc(alike);
  // The ballots that follow bring lanes together, but say nothing about memory.
  __syncwarp();
  return before + __popc(alike & lanes_before());
}

/// Start and number of the keys of one digit, the number of this thread, in the block's order.
struct DigitRun {
  int begin, count;
};

/// Replaces each warp's count of a digit by where the warp's keys of it begin in the block's order.
/// All threads of the block call it.
__device__ __forceinline__ DigitRun order_digits(int (*counts)[DIGITS]) {
  const int digit = threadIdx.x;
  int count = 0;
  // Unrolled further, these loops take registers that the keys need.
#pragma unroll 4
  for (int w = 0; digit < DIGITS && w < SORT_WARPS; ++w) {
    const int own = counts[w][digit];
    counts[w][digit] = count;
    count += own;
  }
  const int begin = block_sum<SORT_THREADS>(count).before;
#pragma unroll 4
  for (int w = 0; digit < DIGITS && w < SORT_WARPS; ++w) counts[w][digit] += begin;
  return {begin, count};
}

/// Shared memory of ``scatter``: first counts, then keys and payload in the block's order.
template <class Key>
union SortMemory {
  int counts[SORT_WARPS][DIGITS];
  struct {
    Key keys[SORT_THREADS * KEYS_PER_THREAD<Key>];
    int payload[SORT_THREADS * KEYS_PER_THREAD<Key>];
  } ordered;
};

/// One thread's share of a block's keys. Each warp has a part of its own, lest a later warp's keys
/// come before an earlier one's.
template <class Key>
struct Share {
  static constexpr int ITEMS = KEYS_PER_THREAD<Key>;
  Key keys[ITEMS];
  /// Number of the warp's keys before each; then its place in the block's order.
  int places[ITEMS];
};

/// Which of the block's keys is this thread's first; the others are 32 apart.
template <class Key>
__device__ __forceinline__ int first_of_share() {
  return warp_index() * WARP * KEYS_PER_THREAD<Key> + lane_index();
}

/// Loads and ranks the keys; ``counts`` of the warp are 0 before.
template <class Key>
__device__ __forceinline__ Share<Key> rank_keys(const ScatterJob& job, const KeyBlock& block,
                                                int* counts) {
  const Key* from = static_cast<const Key*>(job.keys) + block.first;
  const int first = first_of_share<Key>();
  Share<Key> share;
#pragma unroll
  for (int i = 0; i < Share<Key>::ITEMS; ++i) {
    const int index = first + i * WARP;
    share.keys[i] = index < block.count ? from[index] : Key(0);
  }
#pragma unroll
  for (int i = 0; i < Share<Key>::ITEMS; ++i) {
    const bool valid = first + i * WARP < block.count;
    const int digit = digit_of(share.keys[i], job.field);
    share.places[i] = rank_in_warp(digit, valid, job.field.digits, counts);
  }
  return share;
}

/// Puts a thread's keys and payload in the block's order. All threads of the block call it.
template <class Key>
__device__ __forceinline__ void put_in_order(const ScatterJob& job, const KeyBlock& block,
                                             Share<Key>& share, SortMemory<Key>& memory) {
  const int* begins = memory.counts[warp_index()];
#pragma unroll
  for (int i = 0; i < Share<Key>::ITEMS; ++i) {
    share.places[i] += begins[digit_of(share.keys[i], job.field)];
  }
  // From here on the counts' memory has another use.
  __syncthreads();
  const int* payload = job.payload ? job.payload + block.first : nullptr;
  const int first = first_of_share<Key>();
#pragma unroll
  for (int i = 0; i < Share<Key>::ITEMS; ++i) {
    const int index = first + i * WARP;
    if (index >= block.count) continue;
    memory.ordered.keys[share.places[i]] = share.keys[i];
    memory.ordered.payload[share.places[i]] = payload ? payload[index] : int(block.first) + index;
  }
  __syncthreads();
}

/// The number of keys of one digit, the number of this thread, in all blocks before this one, which
/// has ``own``. Words of earlier passes do not count: each pass has kinds of its own.
__device__ __forceinline__ int64 keys_before(const ScatterJob& job, int block, int own) {
  const int own_sum = 2 * job.pass + OWN_SUM, running_sum = 2 * job.pass + RUNNING_SUM;
  uint64* words = job.words + threadIdx.x;
  tell_sum(words + int64(block) * DIGITS, own_sum, own);
  int64 sum = 0;
  for (int other = block - 1; other >= 0; --other) {
    const uint64 word = await_sum(words + int64(other) * DIGITS, own_sum);
    sum += sum_of(word);
    if (kind_of(word) == running_sum) break;
  }
  tell_sum(words + int64(block) * DIGITS, running_sum, sum + own);
  return sum;
}

/// Takes keys and payload to their places; one block of threads per block of keys.
template <class Key>
__global__ void __launch_bounds__(SORT_THREADS, 2) scatter(ScatterJob job) {
  __shared__ SortMemory<Key> memory;
  // From a place in the block's order to the place among all keys, by digit.
  __shared__ int64 moves[DIGITS];
  for (int i = threadIdx.x; i < SORT_WARPS * DIGITS; i += SORT_THREADS) {
    memory.counts[i / DIGITS][i % DIGITS] = 0;
  }
  const int number = take_number(job.next);
  const KeyBlock block = key_block<Key>(number, count_of(job));
  if (block.count <= 0) return;  // Nor has any later block keys.
  Share<Key> share = rank_keys<Key>(job, block, memory.counts[warp_index()]);
  __syncthreads();
  const DigitRun run = order_digits(memory.counts);
  const int digit = threadIdx.x;
  const bool has_digit = digit < job.field.digits;
  const int64 before = has_digit ? keys_before(job, number, run.count) : 0;
  __syncthreads();
  const int all = has_digit ? int(job.counts[digit]) : 0;
  const int first = block_sum<SORT_THREADS>(all).before;
  if (has_digit) moves[digit] = first + before - run.begin;
  __syncthreads();
  put_in_order(job, block, share, memory);
  for (int place = threadIdx.x; place < block.count; place += SORT_THREADS) {
    const Key key = memory.ordered.keys[place];
    const int64 to = moves[digit_of(key, job.field)] + place;
    static_cast<Key*>(job.sorted_keys)[to] = key;
    job.sorted_payload[to] = memory.ordered.payload[place];
  }
}

}  // namespace cuda
}  // namespace gsfw
