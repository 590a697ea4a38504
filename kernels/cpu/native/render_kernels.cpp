// The kernels of rendering in float32, compiled once per instruction set.
#include "bin.h"
#include "blend_backward.h"
#include "render_table.h"
#include "project_backward.h"

namespace gsfw {
namespace GSFW_ISA {

extern const RenderKernels<float> render_float32;

const RenderKernels<float> render_float32 = {
    blend_backward_scratch<float>, project_task<float>,   intersect<float>,
    blend<float>,                  blend_backward<float>, project_backward_task<float>};

}  // namespace GSFW_ISA
}  // namespace gsfw
