// The kernels of the step besides rendering, compiled once per instruction set.
#include "adam.h"
#include "finite.h"
#include "loss_gradient.h"
#include "noise.h"
#include "ssim.h"
#include "step_stages.h"

namespace gsfw {
namespace GSFW_ISA {

extern const StepKernels<float> step_float32;
extern const StepKernels<double> step_float64;

const StepKernels<float> step_float32 = {ssim_scratch<float>, ssim<float>, loss_gradient<float>,
                                         adam<float>, all_finite<float>, add_noise<float>};
const StepKernels<double> step_float64 = {ssim_scratch<double>, ssim<double>,
                                          loss_gradient<double>, adam<double>, all_finite<double>,
                                           add_noise<double>};

}  // namespace GSFW_ISA
}  // namespace gsfw
