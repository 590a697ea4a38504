// Fiber: how one stack is left for another, by hand where the processor is known.
#include "fiber.h"

#include <cstdint>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#include <sanitizer/common_interface_defs.h>
#endif

#if defined(__APPLE__)
#define ASSEMBLY_NAME "_emulation_switch"
#else
#define ASSEMBLY_NAME "emulation_switch"
#endif

// Saves on the stack what registers a function must preserve, and that stack's top in ``*from``;
// then takes them from the other stack and goes on there. It jumps, since the processor would
// expect a ``ret`` to return to the caller.
#if defined(EMULATION_UCONTEXT)
// The system does it, at the price of one call to it per switch.
#elif defined(__x86_64__)
asm(R"(
.text
.globl )" ASSEMBLY_NAME R"(
)" ASSEMBLY_NAME R"(:
  pushq %rbp
  pushq %rbx
  pushq %r12
  pushq %r13
  pushq %r14
  pushq %r15
  movq %rsp, (%rdi)
  movq %rsi, %rsp
  popq %r15
  popq %r14
  popq %r13
  popq %r12
  popq %rbx
  popq %rbp
  popq %rcx
  jmpq *%rcx
)");
extern "C" void emulation_switch(void** from, void* to);
#elif defined(__aarch64__)
asm(R"(
.text
.balign 4
.globl )" ASSEMBLY_NAME R"(
)" ASSEMBLY_NAME R"(:
  sub sp, sp, #160
  stp x19, x20, [sp, #0]
  stp x21, x22, [sp, #16]
  stp x23, x24, [sp, #32]
  stp x25, x26, [sp, #48]
  stp x27, x28, [sp, #64]
  stp x29, x30, [sp, #80]
  stp d8, d9, [sp, #96]
  stp d10, d11, [sp, #112]
  stp d12, d13, [sp, #128]
  stp d14, d15, [sp, #144]
  mov x9, sp
  str x9, [x0]
  mov sp, x1
  ldp x19, x20, [sp, #0]
  ldp x21, x22, [sp, #16]
  ldp x23, x24, [sp, #32]
  ldp x25, x26, [sp, #48]
  ldp x27, x28, [sp, #64]
  ldp x29, x30, [sp, #80]
  ldp d8, d9, [sp, #96]
  ldp d10, d11, [sp, #112]
  ldp d12, d13, [sp, #128]
  ldp d14, d15, [sp, #144]
  add sp, sp, #160
  ret
)");
extern "C" void emulation_switch(void** from, void* to);
#endif

namespace emulation {

#ifdef __SANITIZE_ADDRESS__
/// The one that was left last.
static thread_local Fiber* left = nullptr;
#endif

void arrive() {
#ifdef __SANITIZE_ADDRESS__
  __sanitizer_finish_switch_fiber(nullptr, const_cast<const void**>(
      reinterpret_cast<void**>(&left->stack)), &left->stack_bytes);
#endif
}

void switch_fiber(Fiber& from, Fiber& to, [[maybe_unused]] bool ends) {
#ifdef __SANITIZE_ADDRESS__
  left = &from;
  __sanitizer_start_switch_fiber(ends ? nullptr : &from.fake_stack, to.stack, to.stack_bytes);
#endif
#ifdef EMULATION_UCONTEXT
  swapcontext(&from.context, &to.context);
#else
  emulation_switch(&from.stack_pointer, to.stack_pointer);
#endif
#ifdef __SANITIZE_ADDRESS__
  // The stack of the system's thread becomes known when it is first left.
  __sanitizer_finish_switch_fiber(from.fake_stack, const_cast<const void**>(
      reinterpret_cast<void**>(&left->stack)), &left->stack_bytes);
#endif
}

void prepare(Fiber& fiber, char* stack, std::size_t bytes, void (*entry)()) {
  fiber.stack = stack;
  fiber.stack_bytes = bytes;
  fiber.fake_stack = nullptr;
#ifdef __SANITIZE_ADDRESS__
  // A fiber that never came to its end has left its marks.
  __asan_unpoison_memory_region(stack, bytes);
#endif
#ifdef EMULATION_UCONTEXT
  getcontext(&fiber.context);
  fiber.context.uc_stack.ss_sp = stack;
  fiber.context.uc_stack.ss_size = bytes;
  fiber.context.uc_link = nullptr;
  makecontext(&fiber.context, entry, 0);
#else
  const auto end = reinterpret_cast<std::uintptr_t>(stack + bytes) & ~std::uintptr_t(15);
  void** top = reinterpret_cast<void**>(end);
#if defined(__x86_64__)
  // As a call leaves it: the return address of ``entry``, which has none, above its own.
  constexpr int saved = 8, address = 6;
#else
  constexpr int saved = 20, address = 11;
#endif
  top -= saved;
  for (int i = 0; i < saved; ++i) top[i] = nullptr;
  top[address] = reinterpret_cast<void*>(entry);
  fiber.stack_pointer = top;
#endif
}

}  // namespace emulation
