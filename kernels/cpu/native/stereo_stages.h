// Arguments of the native stereo: plain structures, the same in every translation unit, and one
// table of functions per instruction set.
#pragma once

#include <stdint.h>

namespace gsfw {

/// Half of the window of a comparison, in pixels.
constexpr int64_t SWEEP_REACH = 2;
/// Costs are whole numbers up to this one, so that sums along a path fit 8 bits.
constexpr int COST_SCALE = 128;

/// A grey image as squares of four pixels: byte 0 is the pixel itself, 1 the one to its right, 2
/// and 3 those below. One load then gives all that an interpolated value is made of.
struct Quads {
  /// [height, width]; the last row and column repeat themselves.
  const uint32_t* data;
  int64_t height, width;
};

/// A camera that the reference is compared with. Pixel (x, y) of the reference at the inverse depth
/// q lies at ``turn`` (x, y, 1) + q ``shift``, in homogeneous pixels of this camera.
struct SweepNeighbor {
  Quads image;
  float turn[9], shift[3];
};

/// The sweep of one reference camera.
struct SweepJob {
  /// [height, width], grey in [0, 1].
  const float* image;
  int64_t height, width;
  const SweepNeighbor* neighbors;
  int64_t num_neighbors;
  /// Inverse depths of the first and the last plane; those between are at equal steps.
  float first, last;
  int64_t planes;
};

/// Penalties of semi-global matching, in costs.
struct MatchingJob {
  /// [height, planes, width]
  const uint8_t* costs;
  /// [height, width], grey in [0, 1].
  const float* image;
  int64_t height, width, planes;
};

/// What a reference camera's pixels have; [height, width] each.
struct SweepResult {
  /// Plane of the least cost, with a fraction.
  float* planes;
  /// Match at it, up to 1, and how far the mean plane is worse, in costs up to 1.
  float* scores;
  float* contrasts;
};

/// See plane_sweep.h and semi_global.h. ``costs`` is [height, planes, width].
struct StereoKernels {
  int64_t (*sweep_scratch)(const SweepJob& job);
  void (*sweep)(const SweepJob& job, uint8_t* costs, float* scratch);
  int64_t (*matching_scratch)(const MatchingJob& job);
  void (*matching)(const MatchingJob& job, const SweepResult& result, uint8_t* scratch);
};

}  // namespace gsfw
