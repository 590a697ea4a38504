// Project pass: from splats to projected splats of one camera, and from the sums of blending back.
#pragma once

#include "memory.h"
#include "render_kernels.h"
#include "stage_times.h"

namespace gsfw {

/// Projected splats as blending takes them; see ``ProjectJob``.
template <typename T>
struct ProjectedSplats {
  int64_t count;
  const T* fields;
  int stride;
  const T* depths;
  const uint8_t* visible;
};

/// The sums that blending leaves; see ``ProjectBackwardJob``.
template <typename T>
struct SlotSums {
  const uint32_t* starts;
  /// Readable for a pack behind the last one.
  const T* slots;
  int stride;
};

/// The arrays that the backward pass of projection writes.
template <typename T>
struct ProjectGradients {
  SplatGradients<T> splats;
  bool accumulate;
  /// [POSE_FIELDS] and [n]; null where not wanted.
  T* pose;
  T* screen_gradient;
  T* absgrad;
};

/// Rendered channels: colour, extra, depth.
template <typename T>
int channels_of(const SplatArrays<T>& splats) {
  return splats.color_channels + splats.extras + splats.depth_channels;
}

/// So many numbers, rounded up to whole packs.
constexpr int64_t whole_packs(int64_t numbers) { return (numbers + 15) / 16 * 16; }

/// Numbers of T in a row of projected splats.
constexpr int projected_stride(int channels) {
  return static_cast<int>(whole_packs(SPLAT_CHANNELS + channels));
}

template <typename T>
class ProjectPass {
 public:
  /// Projects at once, and writes ``radii`` [n].
  ProjectPass(const ViewParameters<T>& view, const SplatArrays<T>& splats, T level_min, int threads,
              T* radii);

  ProjectedSplats<T> projected() const;

  /// The visibility of each row, which is kept.
  const uint8_t* visible() const { return job_.visible; }

  /// Whether the projected splats are still there.
  bool holds() const { return projected_ != nullptr; }

  /// Give the memory of the projected splats back; the backward pass does not read them.
  void release() { projected_.reset(); }

  /// The arrays of the splats must still be there, unchanged.
  void backward(const SlotSums<T>& sums, const ProjectGradients<T>& gradients);

  const StageTimes& times() const { return times_; }

  /// Free the memory that is kept from image to image.
  static void release_memory();

 private:
  struct ProjectedMemory {
    Buffer<T> fields, depths;
  };
  struct VisibleMemory {
    Buffer<uint8_t> rows;
  };
  struct BackwardMemory {
    Buffer<T> sums, pose;
  };

  ProjectJob<T> job_;
  int threads_;
  typename Recycler<ProjectedMemory>::Lease projected_;
  typename Recycler<VisibleMemory>::Lease visible_;
  StageTimes times_{};
};

}  // namespace gsfw
