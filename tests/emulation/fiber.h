// Fiber: a stack of its own, to run on and to leave for another's in the middle of a function.
#pragma once

#include <cstddef>

// A build may define it.
#if !defined(__x86_64__) && !defined(__aarch64__) && !defined(EMULATION_UCONTEXT)
#define EMULATION_UCONTEXT
#endif
#ifdef EMULATION_UCONTEXT
#include <ucontext.h>
#endif

namespace emulation {

struct Fiber {
#ifdef EMULATION_UCONTEXT
  ucontext_t context;
#else
  void* stack_pointer = nullptr;
#endif
  /// The stack's lowest byte, and how many there are; for the sanitizer also what stands in for it.
  char* stack = nullptr;
  std::size_t stack_bytes = 0;
  void* fake_stack = nullptr;
};

/// Has ``fiber`` call ``entry`` when it is first switched to; that must call ``arrive`` first and
/// must not return.
void prepare(Fiber& fiber, char* stack, std::size_t bytes, void (*entry)());

/// Leaves ``from``, which runs now, for ``to``; returns when some fiber switches to ``from``, never
/// if that ``ends``.
void switch_fiber(Fiber& from, Fiber& to, bool ends = false);

/// To be called on a new stack.
void arrive();

}  // namespace emulation
