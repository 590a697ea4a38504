// The kernels of rendering in float64, which serve all instruction sets: they are for accuracy.
#include "bin.h"
#include "blend_backward.h"
#include "render_table.h"
#include "project_backward.h"

namespace gsfw {
namespace GSFW_ISA {

extern const RenderKernels<double> render_float64;

const RenderKernels<double> render_float64 = {
    blend_backward_scratch<double>, project_task<double>,   intersect<double>,
    blend<double>,                  blend_backward<double>, project_backward_task<double>};

}  // namespace GSFW_ISA
}  // namespace gsfw
