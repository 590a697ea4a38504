#include "instruction_sets.h"

#include <atomic>

namespace gsfw {
namespace {

struct Named {
  InstructionSet set;
  const char* name;
};

constexpr Named NAMES[] = {{InstructionSet::avx512, "avx512"},
                           {InstructionSet::avx2, "avx2"},
                           {InstructionSet::neon, "neon"},
                           {InstructionSet::scalar, "scalar"}};

/// Every bit that a set's kernels are built with must be there before the set may be chosen.
bool runs_here(InstructionSet set) {
#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
  __builtin_cpu_init();
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                  __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") &&
                  __builtin_cpu_supports("popcnt");
  if (set == InstructionSet::avx2) return v3;
  if (set == InstructionSet::avx512) {
    return v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  }
#elif defined(__aarch64__) || defined(_M_ARM64)
  if (set == InstructionSet::neon) return true;  // Part of the base architecture.
#endif
  return set == InstructionSet::scalar;
}

InstructionSet best_set() {
  for (const Named& known : NAMES) {
    if (runs_here(known.set)) return known.set;
  }
  return InstructionSet::scalar;
}

std::atomic<InstructionSet>& chosen() {
  static std::atomic<InstructionSet> set{best_set()};
  return set;
}

}  // namespace

std::vector<std::string> instruction_sets() {
  std::vector<std::string> names;
  for (const Named& known : NAMES) {
    if (runs_here(known.set)) names.emplace_back(known.name);
  }
  return names;
}

InstructionSet chosen_instruction_set() { return chosen().load(std::memory_order_relaxed); }

std::string chosen_instruction_set_name() {
  for (const Named& known : NAMES) {
    if (known.set == chosen_instruction_set()) return known.name;
  }
  return "";
}

bool use_instruction_set(const std::string& name) {
  for (const Named& known : NAMES) {
    if (name == known.name && runs_here(known.set)) {
      chosen().store(known.set);
      return true;
    }
  }
  return false;
}

}  // namespace gsfw
