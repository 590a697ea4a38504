// The choice among the instruction sets' kernels of rendering.
#pragma once

#include "render_table.h"
#include "instruction_sets.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                             \
  namespace SET {                                     \
  extern const RenderKernels<float> render_float32; \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE
namespace scalar {
extern const RenderKernels<double> render_float64;
}

/// Those of the chosen instruction set; float64 has one build for all.
template <typename T>
const RenderKernels<T>& render_kernels();

template <>
inline const RenderKernels<float>& render_kernels<float>() {
  return GSFW_CHOOSE(render_float32);
}

template <>
inline const RenderKernels<double>& render_kernels<double>() {
  return scalar::render_float64;
}

}  // namespace gsfw
