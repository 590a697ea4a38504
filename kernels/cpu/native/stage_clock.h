// Stage clock: what lies between two moments, in processor time of all threads and on the wall.
#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>

namespace gsfw {

struct Moment {
  int64_t cpu, wall;

  static Moment now() {
    const auto wall = std::chrono::steady_clock::now().time_since_epoch();
    int64_t cpu = 0;
#if defined(CLOCK_PROCESS_CPUTIME_ID)
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    cpu = int64_t(time.tv_sec) * 1000000000 + time.tv_nsec;
#else
    cpu = int64_t(std::clock()) * (1000000000 / CLOCKS_PER_SEC);
#endif
    return {cpu, std::chrono::duration_cast<std::chrono::nanoseconds>(wall).count()};
  }
};

}  // namespace gsfw
