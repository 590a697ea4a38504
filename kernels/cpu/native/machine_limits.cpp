// Limits of the machine with each instruction set, compiled once per set.
#include "machine_limits.h"

namespace gsfw {
namespace GSFW_ISA {

double measured_fma_gflops(double seconds) { return fma_gflops(seconds); }

double measured_exponential_gexp(double seconds) { return exponential_gexp(seconds); }

}  // namespace GSFW_ISA
}  // namespace gsfw
