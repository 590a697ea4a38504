// Thread: what kernels and the runtime both know of a thread that is being emulated.
#pragma once

namespace emulation {

constexpr int WARP_SIZE = 32;

struct Index {
  unsigned x, y, z;
};

/// Threads that meet at collectives. A set of lanes is a number, one bit per lane.
struct Warp {
  /// What each lane brings to a collective. There are two of each because a lane that is ahead
  /// writes for the next collective while others still read; none can be two ahead.
  unsigned long long slots[2][WARP_SIZE];
  unsigned votes[2];
  int turn;
  /// Lanes that exist, may run, wait for their warp, wait for the block, and have returned.
  unsigned lanes, ready, meeting, blocked, returned;
  /// Where those that wait for their warp do so.
  const char* operation;
};

struct Block {
  Index index, size, blocks;
  /// Threads whose predicate was true at a barrier; two for the same reason.
  int counts[2];
  int turn;
  const char* operation;
};

struct Thread {
  Index index;
  unsigned lane;
  Warp* warp;
  Block* block;
};

#ifdef __linux__
// Reached without a call, as one pointer always finds room beside the variables of the program.
#define EMULATION_NEAR __attribute__((tls_model("initial-exec")))
#else
#define EMULATION_NEAR
#endif

/// The one that runs on this thread of the system.
extern __thread Thread* current EMULATION_NEAR;

/// Returns when all lanes of the warp, or all threads of the block that have not returned, are
/// here. ``operation`` is what CUDA calls it.
void meet_warp(const char* operation);
void meet_block(const char* operation);

/// Ends the launch, which fails with this explanation.
[[noreturn]] void fail(const char* explanation);

/// Everything that starts a grid.
struct Launch {
  unsigned blocks, threads;
  const void* job;
  /// 0: threads and blocks run in order.
  unsigned long long seed;
  int system_threads;
  /// Gets why the launch failed.
  char* message;
  unsigned long long message_size;
};

/// Runs a grid.
///
/// Args:
///   kernel: called by every thread with the job.
///   shared_memory: any address among the shared memory of this thread of the system; null where
///     that is not to be poisoned.
///
/// Returns: 0, or 1 where it failed.
int run(const Launch& launch, void (*kernel)(const void* job), const void* (*shared_memory)());

}  // namespace emulation
