#include "bindings.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "instruction_sets.h"
#include "pool.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                           \
  namespace SET {                                   \
  double measured_fma_gflops(double seconds);       \
  double measured_exponential_gexp(double seconds); \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE

/// For how long a limit of the machine is measured.
constexpr double LIMIT_SECONDS = 0.1;

double fma_gflops() { return GSFW_CHOOSE(measured_fma_gflops)(LIMIT_SECONDS); }

double exponential_gexp() { return GSFW_CHOOSE(measured_exponential_gexp)(LIMIT_SECONDS); }

}  // namespace gsfw

NB_MODULE(_native, module) {
  // An image that is alive when the interpreter ends is no leak of ours.
  nanobind::set_leak_warnings(false);
  module.def("instruction_sets", &gsfw::instruction_sets,
             "Instruction sets this machine can run, the best first; \"scalar\" is the last.");
  module.def("instruction_set", &gsfw::chosen_instruction_set_name, "The one that is used.");
  module.def("use_instruction_set", &gsfw::use_instruction_set, nanobind::arg("name"),
             "Use another one from now on; False when this machine cannot run it.");
  module.def("started_threads", &gsfw::started_threads,
             "Threads that the pool has started so far, the callers' not counted.");
  module.def("fma_gflops", &gsfw::fma_gflops,
             "Multiply-adds of one thread with the set in use, in 10^9 operations per second.");
  module.def("exponential_gexp", &gsfw::exponential_gexp,
             "Powers of two of one thread with the set in use, in 10^9 per second.");
  gsfw::bind_render(module);
  gsfw::bind_step(module);
  gsfw::bind_field(module);
  gsfw::bind_stereo(module);
}
