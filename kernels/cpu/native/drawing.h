// Drawing: one camera's picture, from splats to pixels and from pixel gradients back to splats.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>

#include "drawing_kernels.h"
#include "memory.h"
#include "sort.h"

namespace gsfw {

/// What a stage took, in nanoseconds over all threads and by the clock on the wall.
struct StageTime {
  int64_t cpu = 0;
  int64_t wall = 0;
};

enum Stage { PROJECT, SORT, BIN, BLEND, BLEND_BACKWARD, PROJECT_BACKWARD, STAGES };

/// A picture has more pairs of a splat and a tile than it may.
struct TooManyPairs : std::runtime_error {
  explicit TooManyPairs(int64_t pairs) : std::runtime_error("too many pairs"), count(pairs) {}
  int64_t count;
};

/// Memory per pair besides its slot.
constexpr int64_t PAIR_BYTES = sizeof(Entry) + sizeof(Meeting);

/// How a picture is wanted.
template <typename T>
struct DrawingRequest {
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

/// Where a picture goes; see ``BlendJob`` and ``ProjectJob``.
template <typename T>
struct DrawingOutputs {
  T* image;
  T* alpha;
  uint8_t* visible;
  T* radii;
  /// [n]; null where not wanted.
  T* contribution;
};

/// What a picture's backward pass is given, and where its results go.
template <typename T>
struct DrawingGradients {
  const T* image;
  const T* alpha;
  SplatGradients<T> splats;
  bool accumulate;
  /// [POSE_FIELDS] and [n]; null where not wanted.
  T* pose;
  T* screen_gradient;
  T* absgrad;
};

/// What the backward pass needs of the forward pass.
template <typename T>
struct KeptMemory {
  Buffer<T> brushes, checkpoints;
  Buffer<Entry> entries;
  Buffer<int64_t> tile_starts, chunk_starts;
  Buffer<int32_t> chunks_drawn;
  Buffer<uint32_t> runs;
  Buffer<uint8_t> visible;
};

/// What a pass needs only while it runs.
template <typename T>
struct PassingMemory {
  Buffer<T> depths, slots, scratch, pose;
  Buffer<uint32_t> order;
  SortMemory sort;
  Buffer<int64_t> tile_counts;
  std::vector<std::unique_ptr<Buffer<Meeting>>> meetings;
};

template <typename T>
class Drawing {
 public:
  /// Draws at once. Throws TooManyPairs and std::bad_alloc.
  Drawing(const DrawingRequest<T>& request, const DrawingOutputs<T>& outputs);

  /// The arrays of ``request`` must still be there, unchanged.
  void backward(const DrawingGradients<T>& gradients);

  /// Pairs of a splat and a tile that meet.
  int64_t pairs() const { return pairs_; }
  const std::array<StageTime, STAGES>& times() const { return times_; }

 private:
  using Passing = typename Recycler<PassingMemory<T>>::Lease;

  void project(Passing& memory, const DrawingOutputs<T>& outputs);
  int64_t sort(Passing& memory);
  void bin(Passing& memory, int64_t visible);
  int64_t find_meetings(Passing& memory, int64_t visible, int64_t pieces, int64_t grain,
                        int64_t* lengths);
  void place_entries(Passing& memory, int64_t pieces, const int64_t* lengths);
  void plan_tiles();
  template <typename F>
  void for_each_tile(const F& f) const;
  void blend(Passing& memory, const DrawingOutputs<T>& outputs);
  void sum_contributions(const T* slots, T* to);
  BlendJob<T> blend_job() const;
  T* brush_of(int64_t row) const { return kept_->brushes.get() + row * stride_; }

  const DrawingKernels<T>& kernels_;
  DrawingRequest<T> request_;
  Grid grid_;
  ProjectJob<T> project_job_{};
  typename Recycler<KeptMemory<T>>::Lease kept_;
  int64_t pairs_ = 0;
  int64_t run_length_ = 1;
  int channels_;
  int stride_;
  std::array<StageTime, STAGES> times_{};
};

/// Free the memory that is kept from picture to picture.
void release_drawing_memory();

}  // namespace gsfw
