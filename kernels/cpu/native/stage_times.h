// Stage times: durations of the stages of rendering one image.
#pragma once

#include <array>
#include <cstdint>

#include "stage_clock.h"

namespace gsfw {

/// Duration of a stage in nanoseconds: summed over all threads, and by the wall clock.
struct StageTime {
  int64_t cpu = 0;
  int64_t wall = 0;
};

enum Stage { PROJECT, SORT, BIN, BLEND, BLEND_BACKWARD, PROJECT_BACKWARD, STAGES };

using StageTimes = std::array<StageTime, STAGES>;

/// Adds what passes during its life to a stage's time.
class Timed {
 public:
  explicit Timed(StageTime& stage) : stage_(stage), start_(Moment::now()) {}
  ~Timed() {
    const Moment end = Moment::now();
    stage_.cpu += end.cpu - start_.cpu;
    stage_.wall += end.wall - start_.wall;
  }

 private:
  StageTime& stage_;
  Moment start_;
};

}  // namespace gsfw
