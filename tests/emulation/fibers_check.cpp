// Whether fibers switch on this machine: sums over blocks, with numbers that live in registers.
#include <cstdio>

#include "device.h"
#include "collectives.cu"

using gsfw::cuda::ArrayJob;

static void kernel(const void* job) {
  gsfw::cuda::block_sums<double>(*static_cast<const ArrayJob*>(job));
}

int main() {
  constexpr int BLOCKS = 5, THREADS = 128;
  double numbers[BLOCKS * THREADS], sums[BLOCKS];
  for (int i = 0; i < BLOCKS * THREADS; ++i) numbers[i] = i;
  const ArrayJob job{BLOCKS * THREADS, numbers, sums};
  for (unsigned long long seed = 0; seed < 10; ++seed) {
    char message[1024] = "";
    const int system_threads = 1 + int(seed % 2);
    const emulation::Launch launch{BLOCKS,         THREADS, &job,           seed,
                                   system_threads, message, sizeof(message)};
    // Shared memory is among the runtime's own variables here, which must not be poisoned.
    if (emulation::run(launch, kernel, nullptr) != 0) {
      std::puts(message);
      return 1;
    }
    for (int block = 0; block < BLOCKS; ++block) {
      const double expected = THREADS * (block * THREADS + (THREADS - 1) / 2.0);
      if (sums[block] == expected) continue;
      std::printf("block %d: expected %f, found %f\n", block, expected, sums[block]);
      return 1;
    }
  }
  return 0;
}
