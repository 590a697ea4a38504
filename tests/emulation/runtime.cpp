// Runtime: runs the blocks of a grid, and in each block one fiber per thread.
//
// A fiber runs until it waits for others, and then switches to one that may run. Which that is
// depends on the seed: races that the hardware decides one way or the other show up as results that
// differ between seeds.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#ifdef __linux__
#include <link.h>
#endif

#include "fiber.h"
#include "thread.h"

namespace emulation {

__thread Thread* current EMULATION_NEAR = nullptr;

namespace {

constexpr unsigned MAX_THREADS = 1024;
#ifdef __SANITIZE_ADDRESS__
constexpr std::size_t STACK_BYTES = 512 * 1024;
#else
constexpr std::size_t STACK_BYTES = 128 * 1024;
#endif
/// Stacks that lie a power of two apart compete for the same lines of the caches.
constexpr std::size_t STACK_STRIDE = STACK_BYTES + 17 * 64;
/// What functions of the runtime and of the system's libraries may take of it.
constexpr std::size_t STACK_RESERVE = 16 * 1024;
constexpr const char* OVERRUN = "a thread has overrun its stack";
/// What the lowest bytes of a stack hold as long as nothing overruns it.
constexpr std::uint64_t UNTOUCHED = 0xfeedfacecafebeefull;

/// Kept for the next launch, since the system takes its time to hand out memory.
char* stacks_for(unsigned threads) {
  static thread_local std::unique_ptr<char[]> stacks;
  static thread_local unsigned count = 0;
  if (count < threads) {
    // One more, for what overruns the first.
    stacks.reset(new char[(threads + 1) * STACK_STRIDE]);
    count = threads;
  }
  return stacks.get();
}

/// Vigna's xorshift64*.
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream)
      : state_(seed * 0x9e3779b97f4a7c15ull ^ (stream + 1) * 0xbf58476d1ce4e5b9ull) {
    if (state_ == 0) state_ = 1;
    for (int i = 0; i < 4; ++i) next();
  }

  std::uint32_t next() {
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return std::uint32_t(state_ * 0x2545f4914f6cdd1dull >> 32);
  }

 private:
  std::uint64_t state_;
};

bool differ(const char* a, const char* b) { return a != b && std::strcmp(a, b) != 0; }

struct RunningThread : Thread {
  Fiber fiber;
};

/// Runs blocks one after the other, on one thread of the system.
class Scheduler : public Block {
 public:
  Scheduler(const Launch& launch, void (*kernel)(const void*));

  /// Returns why the block failed, which is empty where it has not.
  std::string run(unsigned block);

  void meet_warp(const char* here);
  void meet_block(const char* here);
  [[noreturn]] void fail(std::string explanation);

 private:
  static void enter();
  void prepare_block(unsigned block);
  [[noreturn]] void finish();
  RunningThread* choose_next();
  unsigned choose(unsigned set);
  void draw_patience();
  void give_way();
  void leave_for(RunningThread* next, bool ends);
  void release_block();
  void make_ready(Warp& warp, unsigned lanes);
  std::uint64_t* floor_of(unsigned thread) const;
  std::string place_of(unsigned thread) const;
  std::string what_waits() const;

  const Launch& launch_;
  void (*kernel_)(const void*);
  char* stacks_;
  std::vector<RunningThread> threads_;
  std::vector<Warp> warps_;
  /// Warps with lanes that may run.
  unsigned ready_warps_ = 0;
  unsigned warp_ = 0;
  unsigned living_ = 0, blocked_ = 0;
  Random random_{0, 0};
  /// One choice in so many, a power of two, leaves a warp that could go on.
  unsigned patience_ = 1;
  Fiber system_;
  std::string failure_;
};

RunningThread& running() { return *static_cast<RunningThread*>(current); }
Scheduler& scheduler() { return *static_cast<Scheduler*>(current->block); }

Scheduler::Scheduler(const Launch& launch, void (*kernel)(const void*))
    : Block{},
      launch_(launch),
      kernel_(kernel),
      stacks_(stacks_for(launch.threads)),
      threads_(launch.threads),
      warps_((launch.threads + WARP_SIZE - 1) / WARP_SIZE) {}

/// The end of a thread's stack, with room below it for what overruns it.
std::uint64_t* Scheduler::floor_of(unsigned thread) const {
  return reinterpret_cast<std::uint64_t*>(stacks_ + (thread + 1) * STACK_STRIDE);
}

void Scheduler::prepare_block(unsigned block) {
  static_cast<Block&>(*this) = {
      {block, 0, 0}, {launch_.threads, 1, 1}, {launch_.blocks, 1, 1}, {0, 0}, 0, nullptr};
  living_ = launch_.threads;
  blocked_ = 0;
  ready_warps_ = 0;
  warp_ = 0;
  random_ = Random(launch_.seed, block);
  draw_patience();
  for (Warp& warp : warps_) {
    warp = Warp{};
    // Lanes beyond the block's end have nothing that one could rely on.
    std::memset(warp.slots, 0xff, sizeof(warp.slots));
  }
  for (unsigned i = 0; i < launch_.threads; ++i) {
    RunningThread& thread = threads_[i];
    static_cast<Thread&>(thread) = {{i, 0, 0}, i % WARP_SIZE, &warps_[i / WARP_SIZE], this};
    prepare(thread.fiber, reinterpret_cast<char*>(floor_of(i)), STACK_BYTES, enter);
    *floor_of(i) = UNTOUCHED;
    thread.warp->lanes |= 1u << thread.lane;
  }
  for (Warp& warp : warps_) make_ready(warp, warp.lanes);
}

std::string Scheduler::run(unsigned block) {
  prepare_block(block);
  failure_.clear();
  RunningThread* first = choose_next();
  current = first;
  switch_fiber(system_, first->fiber);
  current = nullptr;
  for (unsigned i = 0; i < launch_.threads && failure_.empty(); ++i) {
    if (*floor_of(i) != UNTOUCHED) failure_ = OVERRUN;
  }
  return failure_.empty() ? "" : "block " + std::to_string(block) + ": " + failure_;
}

void Scheduler::enter() {
  arrive();
  Scheduler& self = scheduler();
  self.kernel_(self.launch_.job);
  self.finish();
}

void Scheduler::finish() {
  current->warp->returned |= 1u << current->lane;
  --living_;
  // As in hardware, a barrier is for those that have not returned.
  if (living_ > 0 && blocked_ == living_) release_block();
  leave_for(living_ > 0 ? choose_next() : nullptr, true);
  std::abort();  // Nothing comes back here.
}

void Scheduler::make_ready(Warp& warp, unsigned lanes) {
  warp.ready |= lanes;
  if (warp.ready != 0) ready_warps_ |= 1u << (&warp - warps_.data());
}

/// A member of ``set``: the first of them, or any, each as likely as the others.
unsigned Scheduler::choose(unsigned set) {
  if (launch_.seed == 0) return unsigned(std::countr_zero(set));
  for (auto skipped = random_.next() % unsigned(std::popcount(set)); skipped > 0; --skipped) {
    set &= set - 1;
  }
  return unsigned(std::countr_zero(set));
}

/// Warps run alternately, or one of them far ahead of the others, until the next barrier.
void Scheduler::draw_patience() {
  if (launch_.seed != 0) patience_ = 1u << 5u * (random_.next() % 4u);
}

RunningThread* Scheduler::choose_next() {
  if (ready_warps_ == 0) fail(what_waits());
  const bool leaves = launch_.seed != 0 && random_.next() % patience_ == 0;
  if (leaves || (ready_warps_ >> warp_ & 1u) == 0) warp_ = choose(ready_warps_);
  Warp& warp = warps_[warp_];
  const unsigned lane = choose(warp.ready);
  warp.ready &= ~(1u << lane);
  if (warp.ready == 0) ready_warps_ &= ~(1u << warp_);
  return &threads_[warp_ * WARP_SIZE + lane];
}

/// Goes on with ``next``, or ends the block where that is null.
void Scheduler::leave_for(RunningThread* next, bool ends) {
  Fiber& here = running().fiber;
  current = next;
  switch_fiber(here, next != nullptr ? next->fiber : system_, ends);
}

void Scheduler::give_way() {
  RunningThread* next = choose_next();
  if (next == current) return;
  if (__builtin_frame_address(0) < running().fiber.stack + STACK_RESERVE) fail(OVERRUN);
  leave_for(next, false);
}

void Scheduler::meet_warp(const char* here) {
  Warp& warp = *current->warp;
  if (warp.meeting == 0) warp.operation = here;
  if (differ(warp.operation, here)) {
    fail(std::string("lanes of one warp meet at ") + warp.operation + " and " + here);
  }
  warp.meeting |= 1u << current->lane;
  if (warp.meeting == warp.lanes) {
    warp.meeting = 0;
    warp.turn ^= 1;
    warp.votes[warp.turn] = 0;
    make_ready(warp, warp.lanes);
  }
  give_way();
}

void Scheduler::meet_block(const char* here) {
  if (blocked_ == 0) operation = here;
  if (differ(operation, here)) {
    fail(std::string("threads of the block meet at ") + operation + " and " + here);
  }
  current->warp->blocked |= 1u << current->lane;
  if (++blocked_ == living_) release_block();
  give_way();
}

void Scheduler::release_block() {
  blocked_ = 0;
  turn ^= 1;
  counts[turn] = 0;
  for (Warp& warp : warps_) {
    make_ready(warp, warp.blocked);
    warp.blocked = 0;
  }
  warp_ = 0;
  draw_patience();
}

void Scheduler::fail(std::string explanation) {
  failure_ = std::move(explanation);
  leave_for(nullptr, true);
  std::abort();  // Nothing comes back here.
}

std::string Scheduler::place_of(unsigned thread) const {
  const Warp& warp = *threads_[thread].warp;
  const unsigned bit = 1u << threads_[thread].lane;
  if (warp.meeting & bit) return std::string("wait at ") + warp.operation;
  if (warp.blocked & bit) return std::string("wait at ") + operation;
  return "have returned";
}

/// Who waits where, as "a deadlock: threads 0-3, 8 wait at __syncwarp; threads 4-7 have returned".
std::string Scheduler::what_waits() const {
  std::map<std::string, std::string> threads_at;
  for (unsigned first = 0, next = 0; first < launch_.threads; first = next) {
    const std::string place = place_of(first);
    while (next < launch_.threads && place_of(next) == place) ++next;
    std::string& list = threads_at[place];
    list += (list.empty() ? "" : ", ") + std::to_string(first);
    if (next > first + 1) list += "-" + std::to_string(next - 1);
  }
  std::string text;
  for (const auto& [place, list] : threads_at) {
    text += (text.empty() ? "" : "; ") + ("threads " + list + " " + place);
  }
  return "a deadlock: " + text;
}

/// Fills this thread's copy of the shared memory with NaN, or -1: whoever counts on what an earlier
/// block left there is found out.
void poison([[maybe_unused]] const void* shared_memory) {
#ifdef __linux__
  const auto fill = [](dl_phdr_info* library, std::size_t, void* wanted) -> int {
    for (int i = 0; i < library->dlpi_phnum; ++i) {
      const ElfW(Phdr)& part = library->dlpi_phdr[i];
      if (part.p_type != PT_TLS || library->dlpi_tls_data == nullptr) continue;
      char* const begin = static_cast<char*>(library->dlpi_tls_data);
      const char* const address = static_cast<const char*>(wanted);
      if (address < begin || address >= begin + part.p_memsz) continue;
      std::memset(begin, 0xff, part.p_memsz);
      return 1;
    }
    return 0;
  };
  dl_iterate_phdr(fill, const_cast<void*>(shared_memory));
#endif
}

std::vector<unsigned> order_of_blocks(const Launch& launch) {
  std::vector<unsigned> order(launch.blocks);
  std::iota(order.begin(), order.end(), 0u);
  if (launch.seed == 0) return order;
  Random random(launch.seed, ~0ull);
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.next() % i]);
  return order;
}

}  // namespace

void meet_warp(const char* operation) { scheduler().meet_warp(operation); }
void meet_block(const char* operation) { scheduler().meet_block(operation); }
void fail(const char* explanation) { scheduler().fail(explanation); }

int run(const Launch& launch, void (*kernel)(const void*), const void* (*shared_memory)()) {
  const std::vector<unsigned> order = order_of_blocks(launch);
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  const auto work = [&] {
    Scheduler blocks(launch, kernel);
    for (std::size_t i; (i = next++) < order.size() && !failed;) {
      if (shared_memory != nullptr) poison(shared_memory());
      const std::string failure = blocks.run(order[i]);
      if (failure.empty() || failed.exchange(true)) continue;
      std::snprintf(launch.message, launch.message_size, "%s", failure.c_str());
    }
  };
  std::vector<std::thread> others;
  for (int i = 1; i < launch.system_threads; ++i) others.emplace_back(work);
  work();
  for (std::thread& thread : others) thread.join();
  return failed ? 1 : 0;
}

}  // namespace emulation
