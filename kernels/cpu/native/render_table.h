// The stages of rendering for one type of number, as each instruction set has them.
#pragma once

#include "stages.h"

namespace gsfw {

/// See the headers of the same names.
template <typename T>
struct RenderKernels {
  /// Working memory of one thread for blending and its backward pass, in numbers of T.
  int64_t (*scratch)(int stride, int channels);
  void (*project)(const ProjectJob<T>& job, int64_t begin, int64_t end);
  int64_t (*intersect)(const BinJob<T>& job, int64_t begin, int64_t end, const Intersections& to);
  void (*blend)(const BlendJob<T>& job, int tile, T* scratch);
  void (*blend_backward)(const BlendBackwardJob<T>& job, int tile, T* scratch);
  void (*project_backward)(const ProjectBackwardJob<T>& job, int64_t begin, int64_t end, T* sums);
};

}  // namespace gsfw
