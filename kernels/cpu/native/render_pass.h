// Render pass: from splats to one camera's image, and from its gradient back to the splats.
#pragma once

#include <cstdint>

#include "blend_pass.h"
#include "project_pass.h"

namespace gsfw {

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

  /// The arguments of blending alone.
  BlendArguments<T> blending() const {
    return {view.width,           view.height, channels_of(splats), view.alpha_min > T(0), cut_offs,
            background,           pixel_weights, most_pairs,        threads};
  }
};

/// The arrays that the forward pass writes; see ``BlendJob`` and ``ProjectJob``.
template <typename T>
struct RenderOutputs {
  BlendOutputs<T> blended;
  uint8_t* visible;
  T* radii;
};

/// The gradients that the backward pass reads, and the arrays that it writes.
template <typename T>
struct RenderGradients {
  const T* image;
  const T* alpha;
  ProjectGradients<T> projected;
};

template <typename T>
class RenderPass {
 public:
  /// Renders at once. Throws TooManyPairs and std::bad_alloc.
  RenderPass(const RenderArguments<T>& arguments, const RenderOutputs<T>& outputs);

  /// The arrays of ``arguments`` must still be there, unchanged.
  void backward(const RenderGradients<T>& gradients);

  /// Pairs of a splat and a tile that intersect.
  int64_t pairs() const { return blend_.pairs(); }
  StageTimes times() const;

 private:
  ProjectPass<T> project_;
  BlendPass<T> blend_;
};

/// Free the memory that is kept from image to image.
void release_render_memory();

}  // namespace gsfw
