#include "instruction_sets.h"

namespace gsfw {

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
#if (defined(__x86_64__) || defined(__i386__)) && (defined(__GNUC__) || defined(__clang__))
  __builtin_cpu_init();
  const bool fma = __builtin_cpu_supports("fma");
  // Every bit that a kernel is built with must be there before the kernel may be chosen.
  if (fma && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw")) {
    names.emplace_back("avx512");
  }
  if (fma && __builtin_cpu_supports("avx2")) names.emplace_back("avx2");
#elif defined(__aarch64__) || defined(_M_ARM64)
  names.emplace_back("neon");  // Part of the base architecture.
#endif
  names.emplace_back("scalar");
  return names;
}

}  // namespace gsfw
