// The kernels of temporal fields in float64, which serve all instruction sets: they are for
// accuracy.
#include "field_table.h"

namespace gsfw {
namespace GSFW_ISA {

extern const FieldKernels<double> field_float64;

const FieldKernels<double> field_float64 = FIELD_KERNELS<double>;

}  // namespace GSFW_ISA
}  // namespace gsfw
