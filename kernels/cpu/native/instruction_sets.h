// Which instruction sets this machine can run, tested feature bit by feature bit.
#pragma once

#include <string>
#include <vector>

namespace gsfw {

/// Names in order of preference, the best first; "scalar" is always the last.
std::vector<std::string> instruction_sets();

}  // namespace gsfw
