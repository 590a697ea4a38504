// The choice among the instruction sets' kernels of drawing.
#pragma once

#include "drawing_table.h"
#include "instruction_sets.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                             \
  namespace SET {                                     \
  extern const DrawingKernels<float> drawing_float32; \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE
namespace scalar {
extern const DrawingKernels<double> drawing_float64;
}

/// Those of the chosen instruction set; float64 has one build for all.
template <typename T>
const DrawingKernels<T>& drawing_kernels();

template <>
inline const DrawingKernels<float>& drawing_kernels<float>() {
  return GSFW_CHOOSE(drawing_float32);
}

template <>
inline const DrawingKernels<double>& drawing_kernels<double>() {
  return scalar::drawing_float64;
}

}  // namespace gsfw
