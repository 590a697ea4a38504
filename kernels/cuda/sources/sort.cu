// Sort: a stable radix sort, least significant digit first, of unsigned keys and a payload.
//
// A pass over one digit counts its values in every block of keys, sums these counts over all
// blocks, which the host asks torch for, and takes every key to its place. Within a warp, lanes of
// one digit find each other by ballots (Ashkiani et al. 2016, "GPU Multisplit", section 5); within
// a block keys are put in order in shared memory first, so that they leave it in long runs. A sort
// that sums while it scatters (Adinets and Merrill 2022, "Onesweep") reads its keys once less per
// pass, but its blocks wait for one another, which this one need not.
#include "sort_stages.h"

namespace gsfw {
namespace cuda {

constexpr int SORT_WARPS = SORT_THREADS / WARP;
static_assert(DIGITS <= SORT_THREADS, "each digit has a thread");

template <class Key>
__device__ __forceinline__ int digit_of(Key key, const DigitField& field) {
  return int(key >> field.shift) & (field.digits - 1);
}

/// The first key of a block of threads, among all, and how many it has.
struct KeyBlock {
  int64 first;
  int count;
};

template <class Key>
__device__ __forceinline__ KeyBlock own_block(int64 keys) {
  constexpr int MOST = SORT_THREADS * KEYS_PER_THREAD<Key>;
  const int64 first = int64(blockIdx.x) * MOST, left = keys - first;
  return {first, left < MOST ? int(left) : MOST};
}

/// Counts digits; one block of threads per block of keys.
template <class Key>
__global__ void __launch_bounds__(SORT_THREADS) count_digits(DigitsJob job) {
  __shared__ int counts[DIGITS];
  const int digit = threadIdx.x;
  if (digit < DIGITS) counts[digit] = 0;
  __syncthreads();
  const KeyBlock block = own_block<Key>(job.count);
  const Key* keys = static_cast<const Key*>(job.keys) + block.first;
#pragma unroll
  for (int i = 0; i < KEYS_PER_THREAD<Key>; ++i) {
    const int index = i * SORT_THREADS + int(threadIdx.x);
    if (index < block.count) atomicAdd(&counts[digit_of(keys[index], job.field)], 1);
  }
  __syncthreads();
  if (digit < job.field.digits) {
    job.counts[int64(digit) * gridDim.x + blockIdx.x] = counts[digit];
  }
}

/// The lanes, among those that are ``valid``, whose digit is this lane's. A warp collective.
__device__ __forceinline__ uint32 lanes_alike(int digit, bool valid) {
  uint32 alike = __ballot_sync(FULL_WARP, valid);
#pragma unroll
  for (int bit = 1; bit < DIGITS; bit *= 2) {
    const bool set = (digit & bit) != 0;
    const uint32 lanes = __ballot_sync(FULL_WARP, set);
    alike &= set ? lanes : ~lanes;
  }
  return alike;
}

/// Number of earlier keys of the warp with its digit; counts it. ``counts`` are the warp's.
/// A warp collective.
__device__ __forceinline__ int rank_in_warp(int digit, bool valid, int* counts) {
  const uint32 alike = lanes_alike(digit, valid);
  const int before = counts[digit];
  __syncwarp();
  const bool last = valid && (alike >> lane_index()) == 1u;
  if (last) counts[digit] = before + __popc(alike);
  // The ballots that follow bring lanes together, but say nothing about memory.
  __syncwarp();
  return before + __popc(alike & lanes_before());
}

/// The sum of the values of all threads before this one. All threads of the block call it.
__device__ __forceinline__ int sum_before(int value) {
  __shared__ int sums[SORT_WARPS];
  const int running = warp_running_sum(value);
  if (lane_index() == WARP - 1) sums[warp_index()] = running;
  __syncthreads();
  int before = running - value;
#pragma unroll
  for (int w = 0; w < SORT_WARPS; ++w) {
    if (w < warp_index()) before += sums[w];
  }
  return before;
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
  const int begin = sum_before(count);
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
    share.places[i] = rank_in_warp(digit_of(share.keys[i], job.field), valid, counts);
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

/// Takes keys and payload to their places; one block of threads per block of keys.
template <class Key>
__global__ void __launch_bounds__(SORT_THREADS, 2) scatter(ScatterJob job) {
  __shared__ SortMemory<Key> memory;
  // From a place in the block's order to the place among all keys, by digit.
  __shared__ int64 moves[DIGITS];
  for (int i = threadIdx.x; i < SORT_WARPS * DIGITS; i += SORT_THREADS) {
    memory.counts[i / DIGITS][i % DIGITS] = 0;
  }
  __syncthreads();
  const KeyBlock block = own_block<Key>(job.count);
  Share<Key> share = rank_keys<Key>(job, block, memory.counts[warp_index()]);
  __syncthreads();
  const DigitRun run = order_digits(memory.counts);
  const int digit = threadIdx.x;
  if (digit < job.field.digits) {
    const int64 end = job.ends[int64(digit) * gridDim.x + blockIdx.x];
    moves[digit] = end - run.count - run.begin;
  }
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
