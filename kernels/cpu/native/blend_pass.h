// Blend pass: from projected splats to an image, and from its gradient to sums for each of them.
#pragma once

#include <cstdint>
#include <stdexcept>

#include "memory.h"
#include "project_pass.h"
#include "render_kernels.h"
#include "sort.h"
#include "stage_times.h"

namespace gsfw {

/// An image has more pairs of a splat and a tile than it may.
struct TooManyPairs : std::runtime_error {
  explicit TooManyPairs(int64_t pairs) : std::runtime_error("too many pairs"), count(pairs) {}
  int64_t count;
};

/// Intersections of a run of splats.
class IntersectionMemory {
 public:
  /// Room for ``size`` of them behind the first ``used``, which are kept.
  Intersections grow(size_t used, size_t size) {
    return {tiles_.grow(used, used + size) + used, blocks_.grow(used, used + size) + used};
  }
  Intersections get() const { return {tiles_.get(), blocks_.get()}; }

 private:
  Buffer<uint32_t> tiles_;
  Buffer<uint16_t> blocks_;
};

/// Memory per pair besides its slot.
constexpr int64_t PAIR_BYTES = sizeof(Entry) + sizeof(uint32_t) + sizeof(uint16_t);

/// What an image is blended with, besides its splats.
template <typename T>
struct BlendArguments {
  int width, height;
  int channels;
  /// False when every splat is to reach the whole image.
  bool bounded;
  CutOffs<T> cut_offs;
  /// [channels]
  const T* background;
  /// [h, w]: see ``BlendJob``.
  const T* pixel_weights;
  int64_t most_pairs;
  int threads;
};

/// The arrays that blending writes; see ``BlendJob``.
template <typename T>
struct BlendOutputs {
  T* image;
  T* alpha;
  /// [n]; null where not wanted.
  T* contribution;
};

/// The gradients that the backward pass of blending reads.
template <typename T>
struct BlendGradients {
  /// [h, w, channels]
  const T* image;
  /// [h, w]; null for zeros.
  const T* alpha;
  /// Sum magnitudes as well.
  bool absolute;
};

/// Memory of the forward pass that the backward pass reads.
template <typename T>
struct KeptMemory {
  Buffer<T> checkpoints;
  Buffer<Entry> entries;
  Buffer<int64_t> tile_starts, chunk_starts;
  Buffer<int32_t> chunks_blended;
  Buffer<uint32_t> runs, slot_starts;
};

/// Working memory of a pass.
template <typename T>
struct PassingMemory {
  Buffer<T> slots, scratch;
  Buffer<uint32_t> order;
  SortMemory sort;
  Buffer<int64_t> tile_counts;
  std::vector<std::unique_ptr<IntersectionMemory>> intersections;
};

template <typename T>
class BlendPass {
 public:
  using Passing = typename Recycler<PassingMemory<T>>::Lease;

  /// The slots of a backward pass, with the memory that they are in.
  struct Slots {
    Passing memory;
    SlotSums<T> sums;
  };

  /// Blends at once. Throws TooManyPairs and std::bad_alloc.
  BlendPass(const BlendArguments<T>& arguments, const ProjectedSplats<T>& splats,
            const BlendOutputs<T>& outputs);

  /// The arrays of the arguments and the splats must still be there, unchanged.
  Slots backward(const BlendGradients<T>& gradients);

  /// Splats, whether visible or not.
  int64_t num_splats() const { return splats_.count; }

  /// Pairs of a splat and a tile that intersect.
  int64_t pairs() const { return pairs_; }
  const StageTimes& times() const { return times_; }

  /// Free the memory that is kept from image to image.
  static void release_memory();

 private:
  int64_t num_tiles() const { return int64_t(grid_.columns) * grid_.rows; }
  int64_t sort(Passing& memory);
  void bin(Passing& memory, int64_t visible);
  int64_t find_intersections(Passing& memory, int64_t visible, int64_t pieces, int64_t grain);
  void number_slots();
  void place_entries(Passing& memory, int64_t visible, int64_t pieces, int64_t grain);
  void plan_tiles();
  template <typename F>
  void for_each_tile(const F& f) const;
  void blend(Passing& memory, const BlendOutputs<T>& outputs);
  void sum_contributions(const T* slots, T* to);
  BlendJob<T> blend_job() const;

  const RenderKernels<T>& kernels_;
  BlendArguments<T> arguments_;
  ProjectedSplats<T> splats_;
  Grid grid_;
  typename Recycler<KeptMemory<T>>::Lease kept_;
  int64_t pairs_ = 0;
  int64_t run_length_ = 1;
  StageTimes times_{};
};

}  // namespace gsfw
