// Render pass: from splats to one camera's image, and from its gradient back to the splats.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>

#include "memory.h"
#include "render_kernels.h"
#include "sort.h"

namespace gsfw {

/// Duration of a stage in nanoseconds: summed over all threads, and by the wall clock.
struct StageTime {
  int64_t cpu = 0;
  int64_t wall = 0;
};

enum Stage { PROJECT, SORT, BIN, BLEND, BLEND_BACKWARD, PROJECT_BACKWARD, STAGES };

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

/// The arguments of one image.
template <typename T>
struct RenderArguments {
  ViewParameters<T> view;
  SplatArrays<T> splats;
  CutOffs<T> cut_offs;
  /// [channels]
  const T* background;
  /// [h, w]: see ``BlendJob``.
  const T* pixel_weights;
  int64_t most_pairs;
  int threads;
};

/// The arrays that the forward pass writes; see ``BlendJob`` and ``ProjectJob``.
template <typename T>
struct RenderOutputs {
  T* image;
  T* alpha;
  uint8_t* visible;
  T* radii;
  /// [n]; null where not wanted.
  T* contribution;
};

/// The gradients that the backward pass reads, and the arrays that it writes.
template <typename T>
struct RenderGradients {
  const T* image;
  const T* alpha;
  SplatGradients<T> splats;
  bool accumulate;
  /// [POSE_FIELDS] and [n]; null where not wanted.
  T* pose;
  T* screen_gradient;
  T* absgrad;
};

/// Memory of the forward pass that the backward pass reads.
template <typename T>
struct KeptMemory {
  Buffer<T> projected, checkpoints;
  Buffer<Entry> entries;
  Buffer<int64_t> tile_starts, chunk_starts;
  Buffer<int32_t> chunks_blended;
  Buffer<uint32_t> runs, slot_starts;
  Buffer<uint8_t> visible;
};

/// Working memory of a pass.
template <typename T>
struct PassingMemory {
  Buffer<T> depths, slots, scratch, pose;
  Buffer<uint32_t> order;
  SortMemory sort;
  Buffer<int64_t> tile_counts;
  std::vector<std::unique_ptr<IntersectionMemory>> intersections;
};

template <typename T>
class RenderPass {
 public:
  /// Renders at once. Throws TooManyPairs and std::bad_alloc.
  RenderPass(const RenderArguments<T>& arguments, const RenderOutputs<T>& outputs);

  /// The arrays of ``arguments`` must still be there, unchanged.
  void backward(const RenderGradients<T>& gradients);

  /// Pairs of a splat and a tile that intersect.
  int64_t pairs() const { return pairs_; }
  const std::array<StageTime, STAGES>& times() const { return times_; }

 private:
  using Passing = typename Recycler<PassingMemory<T>>::Lease;

  void project(Passing& memory, const RenderOutputs<T>& outputs);
  int64_t sort(Passing& memory);
  void bin(Passing& memory, int64_t visible);
  int64_t find_intersections(Passing& memory, int64_t visible, int64_t pieces, int64_t grain);
  void number_slots();
  void place_entries(Passing& memory, int64_t visible, int64_t pieces, int64_t grain);
  void plan_tiles();
  template <typename F>
  void for_each_tile(const F& f) const;
  void blend(Passing& memory, const RenderOutputs<T>& outputs);
  void sum_contributions(const T* slots, T* to);
  BlendJob<T> blend_job() const;

  const RenderKernels<T>& kernels_;
  RenderArguments<T> arguments_;
  Grid grid_;
  ProjectJob<T> project_job_{};
  typename Recycler<KeptMemory<T>>::Lease kept_;
  int64_t pairs_ = 0;
  int64_t run_length_ = 1;
  int channels_;
  int stride_;
  std::array<StageTime, STAGES> times_{};
};

/// Free the memory that is kept from image to image.
void release_render_memory();

}  // namespace gsfw
