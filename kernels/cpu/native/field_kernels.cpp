// The kernels of temporal fields in float32, compiled once per instruction set.
#include "field_table.h"

namespace gsfw {
namespace GSFW_ISA {

extern const FieldKernels<float> field_float32;

const FieldKernels<float> field_float32 = FIELD_KERNELS<float>;

}  // namespace GSFW_ISA
}  // namespace gsfw
