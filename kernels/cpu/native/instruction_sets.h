// Which instruction sets this machine can run, tested feature bit by feature bit, and which is
// used.
#pragma once

#include <string>
#include <vector>

namespace gsfw {

/// Kernels are compiled once for each of these; the best first.
enum class InstructionSet { avx512, avx2, neon, scalar };

/// Names of those that this build has and this machine can run, the best first; "scalar" is the
/// last.
std::vector<std::string> instruction_sets();

/// The one that is used: the first, unless ``use_instruction_set`` said otherwise.
InstructionSet chosen_instruction_set();

/// Its name.
std::string chosen_instruction_set_name();

/// Use the set called ``name`` from now on; false when it is not among ``instruction_sets``.
bool use_instruction_set(const std::string& name);

/// The chosen set's own: ``TABLE`` is a table or a function that each set's namespace has.
#if defined(__x86_64__) || defined(_M_X64)
#define GSFW_CHOOSE(TABLE)                                           \
  (chosen_instruction_set() == InstructionSet::avx512 ? avx512::TABLE \
   : chosen_instruction_set() == InstructionSet::avx2 ? avx2::TABLE   \
                                                      : scalar::TABLE)
#define GSFW_FOR_EACH_SET(DECLARE) DECLARE(avx512) DECLARE(avx2) DECLARE(scalar)
#elif defined(__aarch64__) || defined(_M_ARM64)
#define GSFW_CHOOSE(TABLE) \
  (chosen_instruction_set() == InstructionSet::neon ? neon::TABLE : scalar::TABLE)
#define GSFW_FOR_EACH_SET(DECLARE) DECLARE(neon) DECLARE(scalar)
#else
#define GSFW_CHOOSE(TABLE) (scalar::TABLE)
#define GSFW_FOR_EACH_SET(DECLARE) DECLARE(scalar)
#endif

}  // namespace gsfw
