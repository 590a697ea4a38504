// The kernels of drawing in float32, compiled once per instruction set.
#include "bin.h"
#include "blend_backward.h"
#include "drawing_table.h"
#include "project_backward.h"

namespace gsfw {
namespace GSFW_ISA {

extern const DrawingKernels<float> drawing_float32;

const DrawingKernels<float> drawing_float32 = {
    blend_backward_scratch<float>, project_task<float>,   meet<float>,
    blend<float>,                  blend_backward<float>, project_backward_task<float>};

}  // namespace GSFW_ISA
}  // namespace gsfw
