#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "instruction_sets.h"

NB_MODULE(_native, module) {
  module.def("instruction_sets", &gsfw::instruction_sets,
             "Instruction sets this machine can run, the best first; \"scalar\" is the last.");
}
