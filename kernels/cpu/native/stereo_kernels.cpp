// The kernels of stereo, compiled once per instruction set.
#include "plane_sweep.h"
#include "semi_global.h"
#include "stereo_stages.h"

namespace gsfw {
namespace GSFW_ISA {

extern const StereoKernels stereo_kernels;

const StereoKernels stereo_kernels = {sweep_scratch, sweep, matching_scratch, matching};

}  // namespace GSFW_ISA
}  // namespace gsfw
