// The parts of the Python module.
#pragma once

#include <nanobind/nanobind.h>

namespace gsfw {

void bind_render(nanobind::module_& module);
void bind_step(nanobind::module_& module);
void bind_field(nanobind::module_& module);
void bind_stereo(nanobind::module_& module);

}  // namespace gsfw
