#include "blend_pass.h"

#include <algorithm>
#include <atomic>
#include <numeric>
#include <utility>

#include "pool.h"

namespace gsfw {
namespace {

Grid grid_of(int width, int height) {
  return {width, height, (width + TILE - 1) / TILE, (height + TILE - 1) / TILE};
}

/// Pieces that a thread gets of work whose order matters: enough for the fast to help the slow.
constexpr int PIECES_PER_THREAD = 4;

/// Runs of tiles that a thread gets.
constexpr int RUNS_PER_THREAD = 16;

}  // namespace

template <typename T>
BlendPass<T>::BlendPass(const BlendArguments<T>& arguments, const ProjectedSplats<T>& splats,
                        const BlendOutputs<T>& outputs)
    : kernels_(render_kernels<T>()),
      arguments_(arguments),
      splats_(splats),
      grid_(grid_of(arguments.width, arguments.height)),
      kept_(Recycler<KeptMemory<T>>::instance().take()) {
  Passing memory = Recycler<PassingMemory<T>>::instance().take();
  const int64_t visible = sort(memory);
  bin(memory, visible);
  blend(memory, outputs);
}

template <typename T>
int64_t BlendPass<T>::sort(Passing& memory) {
  const Timed timed(times_[SORT]);
  const int64_t count = splats_.count;
  return sort_by_depth(splats_.depths, splats_.visible, count, arguments_.threads,
                       memory->sort, memory->order.reserve(count));
}

template <typename T>
void BlendPass<T>::bin(Passing& memory, int64_t visible) {
  const Timed timed(times_[BIN]);
  const int64_t most = int64_t(arguments_.threads) * PIECES_PER_THREAD;
  const int64_t grain = std::max<int64_t>((visible + most - 1) / most, 256);
  const int64_t pieces = (visible + grain - 1) / grain;
  pairs_ = find_intersections(memory, visible, pieces, grain);
  if (pairs_ > arguments_.most_pairs) throw TooManyPairs(pairs_);
  number_slots();
  place_entries(memory, visible, pieces, grain);
  plan_tiles();
}

/// Splats that are binned at a time, and intersections that a thread finds before it tells the
/// others.
constexpr int64_t BATCH = 16, UNTOLD = 4096;

/// Find what each splat intersects; counts on beyond the limit, but keeps nothing then.
template <typename T>
int64_t BlendPass<T>::find_intersections(Passing& memory, int64_t visible, int64_t pieces,
                                          int64_t grain) {
  const int64_t tiles = num_tiles();
  const int64_t rows = splats_.count;
  uint32_t* slot_counts = kept_->slot_starts.reserve(rows + 1);
  std::fill(slot_counts, slot_counts + rows + 1, 0u);
  const BinJob<T> job = {grid_, arguments_.bounded, memory->order.get(), visible,
                         splats_.fields, splats_.stride, slot_counts};
  while (static_cast<int64_t>(memory->intersections.size()) < pieces) {
    memory->intersections.push_back(std::make_unique<IntersectionMemory>());
  }
  int64_t* tile_counts = memory->tile_counts.reserve(std::max<int64_t>(pieces, 1) * tiles);
  std::atomic<int64_t> total{0};
  parallel_pieces(visible, grain, arguments_.threads, [&](int64_t begin, int64_t end, int) {
    const int64_t piece = begin / grain;
    int64_t* counts = tile_counts + piece * tiles;
    std::fill(counts, counts + tiles, 0);
    int64_t length = 0, untold = 0;
    for (int64_t rank = begin; rank < end; rank += BATCH) {
      const Intersections to = memory->intersections[piece]->grow(length, BATCH * (tiles + TILE));
      const int64_t more = kernels_.intersect(job, rank, std::min(rank + BATCH, end), to);
      for (int64_t i = 0; i < more; ++i) ++counts[to.tiles[i]];
      untold += more;
      if (total.load(std::memory_order_relaxed) + untold <= arguments_.most_pairs) length += more;
      if (untold >= UNTOLD) total.fetch_add(std::exchange(untold, 0));
    }
    total.fetch_add(untold);
  });
  return total.load();
}

/// Give the slots to rows in the order of the model, in which the backward pass reads them.
template <typename T>
void BlendPass<T>::number_slots() {
  uint32_t* starts = kept_->slot_starts.get();
  std::exclusive_scan(starts, starts + splats_.count + 1, starts, 0u);
}

/// Sort intersections into tiles: those of a tile come from front to back, because pieces do and
/// every piece keeps its order.
template <typename T>
void BlendPass<T>::place_entries(Passing& memory, int64_t visible, int64_t pieces, int64_t grain) {
  const int64_t tiles = num_tiles();
  int64_t* next = memory->tile_counts.get();
  int64_t* starts = kept_->tile_starts.reserve(tiles + 1);
  int64_t total = 0;
  for (int64_t tile = 0; tile < tiles; ++tile) {
    starts[tile] = total;
    for (int64_t p = 0; p < pieces; ++p) total += std::exchange(next[p * tiles + tile], total);
  }
  starts[tiles] = total;
  const uint32_t* slot_starts = kept_->slot_starts.get();
  const uint32_t* order = memory->order.get();
  Entry* entries = kept_->entries.reserve(total);
  parallel_pieces(visible, grain, arguments_.threads, [&](int64_t begin, int64_t end, int) {
    const int64_t piece = begin / grain;
    int64_t* places = next + piece * tiles;
    Intersections from = memory->intersections[piece]->get();
    for (int64_t rank = begin; rank < end; ++rank) {
      const uint32_t row = order[rank];
      for (uint32_t slot = slot_starts[row]; slot < slot_starts[row + 1]; ++slot) {
        Entry* to = entries + places[*from.tiles++]++;
        *to = {row, slot, *from.blocks++};
        // Each tile's entries go to a place of their own: ask for what follows there.
        __builtin_prefetch(to + 8, 1);
      }
    }
  });
}

/// Checkpoints of each tile, and the order in which threads take runs of tiles: the heaviest first.
/// Tiles of a run are neighbours, which share most of their splats: a thread finds these in its own
/// cache, and writes to slots that no other thread is writing next to.
template <typename T>
void BlendPass<T>::plan_tiles() {
  const int64_t tiles = num_tiles();
  const int64_t* starts = kept_->tile_starts.get();
  int64_t* chunks = kept_->chunk_starts.reserve(tiles + 1);
  chunks[0] = 0;
  for (int64_t tile = 0; tile < tiles; ++tile) {
    chunks[tile + 1] = chunks[tile] + (starts[tile + 1] - starts[tile] + CHUNK - 1) / CHUNK;
  }
  run_length_ = std::max<int64_t>(tiles / (int64_t(arguments_.threads) * RUNS_PER_THREAD), 1);
  const int64_t runs = (tiles + run_length_ - 1) / run_length_;
  uint32_t* order = kept_->runs.reserve(runs);
  std::iota(order, order + runs, 0u);
  if (arguments_.threads == 1) return;
  const auto load = [&](uint32_t run) {
    return starts[std::min((run + 1) * run_length_, tiles)] - starts[run * run_length_];
  };
  std::stable_sort(order, order + runs,
                   [&](uint32_t a, uint32_t b) { return load(a) > load(b); });
}

/// Call ``f(tile, worker)`` for every tile.
template <typename T>
template <typename F>
void BlendPass<T>::for_each_tile(const F& f) const {
  const int64_t tiles = num_tiles();
  const uint32_t* order = kept_->runs.get();
  const int64_t runs = (tiles + run_length_ - 1) / run_length_;
  parallel(runs, arguments_.threads, [&](int64_t task, int worker) {
    const int64_t first = order[task] * run_length_;
    const int64_t end = std::min(first + run_length_, tiles);
    for (int64_t tile = first; tile < end; ++tile) f(static_cast<int>(tile), worker);
  });
}

template <typename T>
BlendJob<T> BlendPass<T>::blend_job() const {
  BlendJob<T> job{};
  job.grid = grid_;
  job.cut_offs = arguments_.cut_offs;
  job.projected = splats_.fields;
  job.stride = splats_.stride;
  job.channels = arguments_.channels;
  job.entries = kept_->entries.get();
  job.tile_starts = kept_->tile_starts.get();
  job.chunk_starts = kept_->chunk_starts.get();
  job.checkpoints = kept_->checkpoints.get();
  job.chunks_blended = kept_->chunks_blended.get();
  job.background = arguments_.background;
  job.pixel_weights = arguments_.pixel_weights;
  return job;
}

template <typename T>
void BlendPass<T>::blend(Passing& memory, const BlendOutputs<T>& outputs) {
  const Timed timed(times_[BLEND]);
  const int64_t tiles = num_tiles();
  kept_->checkpoints.reserve(kept_->chunk_starts.get()[tiles] * PIXELS);
  kept_->chunks_blended.reserve(tiles);
  BlendJob<T> job = blend_job();
  job.image = outputs.image;
  job.alpha = outputs.alpha;
  if (outputs.contribution) job.contribution = memory->slots.reserve(pairs_);
  const int64_t size = whole_packs(kernels_.scratch(splats_.stride, arguments_.channels));
  T* scratch = memory->scratch.reserve(size * arguments_.threads);
  for_each_tile([&](int tile, int worker) { kernels_.blend(job, tile, scratch + worker * size); });
  if (outputs.contribution) sum_contributions(job.contribution, outputs.contribution);
}

template <typename T>
void BlendPass<T>::sum_contributions(const T* slots, T* to) {
  const int64_t count = splats_.count;
  const uint32_t* starts = kept_->slot_starts.get();
  parallel_pieces(count, ROWS_PER_TASK, arguments_.threads, [&](int64_t begin, int64_t end, int) {
    for (int64_t row = begin; row < end; ++row) {
      T sum = 0;
      for (uint32_t slot = starts[row]; slot < starts[row + 1]; ++slot) sum += slots[slot];
      to[row] = sum;
    }
  });
}

template <typename T>
typename BlendPass<T>::Slots BlendPass<T>::backward(const BlendGradients<T>& gradients) {
  const Timed timed(times_[BLEND_BACKWARD]);
  Passing memory = Recycler<PassingMemory<T>>::instance().take();
  const int stride = SLOT_CHANNELS + arguments_.channels + (gradients.absolute ? 2 : 0);
  // A row of slots is read in whole packs.
  T* slots = memory->slots.reserve(pairs_ * stride + 16);
  const int64_t size = whole_packs(kernels_.scratch(splats_.stride, arguments_.channels));
  T* scratch = memory->scratch.reserve(size * arguments_.threads);
  const BlendBackwardJob<T> job = {blend_job(), gradients.image, gradients.alpha,
                                   slots,       stride,          gradients.absolute};
  for_each_tile([&](int tile, int worker) {
    kernels_.blend_backward(job, tile, scratch + worker * size);
  });
  return {std::move(memory), {kept_->slot_starts.get(), slots, stride}};
}

template <typename T>
void BlendPass<T>::release_memory() {
  Recycler<KeptMemory<T>>::instance().clear();
  Recycler<PassingMemory<T>>::instance().clear();
}

template class BlendPass<float>;
template class BlendPass<double>;

}  // namespace gsfw
