// Semi-global matching: planes of all pixels that agree with those of their neighbours.
//
// Along eight straight paths the cost of a pixel at each plane gains the least cost of the previous
// pixel, a small penalty for the next plane and a larger one for any other, which is smaller at
// edges of the image (Hirschmueller 2008, "Stereo Processing by Semiglobal Matching and Mutual
// Information", equations 11 to 14).
#pragma once

#include <string.h>

#include "simd/simd.h"
#include "stereo_stages.h"

namespace gsfw {
namespace GSFW_ISA {

/// Penalty of a step to the next plane, and of any larger step where the image has no edge.
constexpr int NEXT_PLANE = 6, OTHER_PLANE = 48;
/// The larger penalty is halved where greys differ by the inverse of this.
constexpr float EDGE_SHARPNESS = 16.0f;
/// Paths that come from the row before: straight on, from the left and from the right.
constexpr int SLANTS = 3;
constexpr int PATHS = 8;

/// Where the sums of one image lie in memory. Rows along x have a number of room at both ends, and
/// so have columns of planes.
struct MatchingRows {
  /// All of it.
  int64_t bytes;
  /// Numbers of a row, and of a column of planes, with that room.
  int64_t across, deep;
  /// [height, planes, width]: sums over the paths.
  uint16_t* sums;
  /// [2, SLANTS, planes, across]: costs along the paths in two rows.
  uint8_t* paths;
  /// [2, SLANTS, across]: the least of them over planes.
  uint8_t* least;
  /// [SLANTS, across]: penalties of a jump.
  uint8_t* jumps;
  /// [width, planes]: costs of a row, and [width, planes] sums of its two paths.
  uint8_t* turned;
  uint16_t* turned_sums;
  /// [2, deep]: costs along a row.
  uint8_t* column;
  /// [3, width]: the least sum so far, its plane, and the sum over planes.
  uint32_t* winners;

  /// In ``scratch``; null to learn the size.
  MatchingRows(const MatchingJob& job, uint8_t* scratch) {
    across = job.width + 2;
    deep = job.planes + 2;
    bytes = 0;
    auto take = [&](int64_t wanted) {
      uint8_t* const from = scratch == nullptr ? nullptr : scratch + bytes;
      bytes += (wanted + 63) / 64 * 64;
      return from;
    };
    const int64_t row = job.planes * job.width;
    sums = reinterpret_cast<uint16_t*>(take(job.height * row * 2));
    paths = take(2 * SLANTS * job.planes * across);
    least = take(2 * SLANTS * across);
    jumps = take(SLANTS * across);
    turned = take(row);
    turned_sums = reinterpret_cast<uint16_t*>(take(row * 2));
    column = take(2 * deep);
    winners = reinterpret_cast<uint32_t*>(take(3 * job.width * 4));
  }
};

inline int64_t matching_scratch(const MatchingJob& job) {
  return MatchingRows(job, nullptr).bytes;
}

GSFW_FUNCTION uint8_t jump_penalty(float here, float before) {
  const float difference = here > before ? here - before : before - here;
  const float penalty = OTHER_PLANE / (1.0f + EDGE_SHARPNESS * difference);
  return uint8_t(penalty < NEXT_PLANE ? NEXT_PLANE : int(penalty));
}

/// One plane of a path from the row before: ``before`` is that plane there, with those next to it.
inline void step_plane(const uint8_t* __restrict cost, const uint8_t* __restrict nearer,
                       const uint8_t* __restrict before, const uint8_t* __restrict farther,
                       const uint8_t* __restrict least, const uint8_t* __restrict jumps,
                       int64_t width, uint8_t* __restrict to, uint8_t* __restrict to_least,
                       uint16_t* __restrict sums) {
  for (int64_t x = 0; x < width; ++x) {
    const uint8_t next = uint8_t((nearer[x] < farther[x] ? nearer[x] : farther[x]) + NEXT_PLANE);
    const uint8_t other = uint8_t(least[x] + jumps[x]);
    uint8_t reached = before[x] < next ? before[x] : next;
    reached = reached < other ? reached : other;
    // Without the least cost the sums would grow along the path.
    const uint8_t value = uint8_t(cost[x] + uint8_t(reached - least[x]));
    to[x] = value;
    to_least[x] = to_least[x] < value ? to_least[x] : value;
    sums[x] = uint16_t(sums[x] + value);
  }
}

/// The three paths that reach row ``y`` from the row ``y - down``; ``turn`` alternates.
inline void step_row(const MatchingJob& job, const MatchingRows& rows, int64_t y, int64_t down,
                     int turn) {
  const int64_t width = job.width, planes = job.planes, across = rows.across;
  const bool begins = y - down < 0 || y - down >= job.height;
  const float* const here = job.image + y * width;
  for (int slant = 0; slant < SLANTS; ++slant) {
    const int64_t aside = slant == 0 ? 0 : slant == 1 ? -1 : 1;
    uint8_t* const jumps = rows.jumps + slant * across;
    const uint8_t* const was = rows.paths + ((1 - turn) * SLANTS + slant) * planes * across;
    const uint8_t* const was_least = rows.least + ((1 - turn) * SLANTS + slant) * across;
    uint8_t* const is = rows.paths + (turn * SLANTS + slant) * planes * across;
    uint8_t* const is_least = rows.least + (turn * SLANTS + slant) * across;
    memset(is_least, 255, across);
    for (int64_t x = 0; x < width; ++x) {
      const bool inside = !begins && x + aside >= 0 && x + aside < width;
      jumps[x] = inside ? jump_penalty(here[x], here[x + aside - down * width]) : 0;
    }
    for (int64_t plane = 0; plane < planes; ++plane) {
      const uint8_t* const before = was + plane * across + 1 + aside;
      const uint8_t* const nearer = plane > 0 ? before - across : before;
      const uint8_t* const farther = plane + 1 < planes ? before + across : before;
      step_plane(job.costs + (y * planes + plane) * width, nearer, before, farther,
                 was_least + 1 + aside, jumps, width, is + plane * across + 1, is_least + 1,
                 rows.sums + (y * planes + plane) * width);
    }
    // Paths that enter at the sides begin there.
    for (int64_t plane = 0; plane < planes; ++plane) {
      is[plane * across] = is[plane * across + width + 1] = 0;
    }
    is_least[0] = is_least[width + 1] = 0;
  }
}

/// One pixel of a path along a row, over all planes.
inline uint8_t step_column(const uint8_t* __restrict cost, const uint8_t* __restrict before,
                           uint8_t least, uint8_t jump, int64_t planes, uint8_t* __restrict to,
                           uint16_t* __restrict sums) {
  const uint8_t other = uint8_t(least + jump);
  uint8_t lowest = 255;
  for (int64_t p = 0; p < planes; ++p) {
    const uint8_t nearer = before[p], farther = before[p + 2], same = before[p + 1];
    const uint8_t next = uint8_t((nearer < farther ? nearer : farther) + NEXT_PLANE);
    uint8_t reached = same < next ? same : next;
    reached = reached < other ? reached : other;
    const uint8_t value = uint8_t(cost[p] + uint8_t(reached - least));
    to[p + 1] = value;
    lowest = lowest < value ? lowest : value;
    sums[p] = uint16_t(sums[p] + value);
  }
  return lowest;
}

/// A path along a row: from its first pixel on for ``right`` = 1, back from its last one for -1.
inline void follow_row(const MatchingJob& job, const MatchingRows& rows, const float* image,
                       int64_t right) {
  const int64_t width = job.width, planes = job.planes;
  uint8_t* before = rows.column;
  uint8_t* to = rows.column + rows.deep;
  memset(rows.column, 0, 2 * rows.deep);
  uint8_t least = 0;
  for (int64_t i = 0; i < width; ++i) {
    const int64_t x = right > 0 ? i : width - 1 - i;
    const uint8_t jump = i > 0 ? jump_penalty(image[x], image[x - right]) : 0;
    least = step_column(rows.turned + x * planes, before, least, jump, planes, to,
                        rows.turned_sums + x * planes);
    // Beyond the first and the last plane there is none.
    to[0] = to[1];
    to[planes + 1] = to[planes];
    uint8_t* const last = before;
    before = to;
    to = last;
  }
}

/// The two paths along row ``y``; sets its sums.
inline void follow_both(const MatchingJob& job, const MatchingRows& rows, int64_t y) {
  const int64_t width = job.width, planes = job.planes;
  const uint8_t* __restrict const costs = job.costs + y * planes * width;
  uint16_t* __restrict const sums = rows.sums + y * planes * width;
  uint8_t* __restrict const turned = rows.turned;
  for (int64_t x = 0; x < width; ++x) {
    for (int64_t p = 0; p < planes; ++p) turned[x * planes + p] = costs[p * width + x];
  }
  memset(rows.turned_sums, 0, planes * width * sizeof(uint16_t));
  follow_row(job, rows, job.image + y * width, 1);
  follow_row(job, rows, job.image + y * width, -1);
  for (int64_t p = 0; p < planes; ++p) {
    for (int64_t x = 0; x < width; ++x) sums[p * width + x] = rows.turned_sums[x * planes + p];
  }
}

/// The plane with the least sum, and where between planes: the place of the least of a parabola.
inline void choose_row(const MatchingJob& job, const MatchingRows& rows, const SweepResult& result,
                       int64_t y) {
  const int64_t width = job.width, planes = job.planes;
  const uint16_t* const sums = rows.sums + y * planes * width;
  uint32_t* __restrict const lowest = rows.winners;
  uint32_t* __restrict const plane = rows.winners + width;
  uint32_t* __restrict const total = rows.winners + 2 * width;
  memset(lowest, 255, width * sizeof(uint32_t));
  memset(total, 0, width * sizeof(uint32_t));
  for (int64_t p = 0; p < planes; ++p) {
    const uint16_t* __restrict const sum = sums + p * width;
    for (int64_t x = 0; x < width; ++x) {
      plane[x] = sum[x] < lowest[x] ? uint32_t(p) : plane[x];
      lowest[x] = sum[x] < lowest[x] ? sum[x] : lowest[x];
      total[x] += sum[x];
    }
  }
  for (int64_t x = 0; x < width; ++x) {
    const int64_t p = plane[x], at = y * width + x;
    const float here = float(sums[p * width + x]);
    const float before = p > 0 ? float(sums[(p - 1) * width + x]) : here;
    const float after = p + 1 < planes ? float(sums[(p + 1) * width + x]) : here;
    const float curvature = before - 2.0f * here + after;
    const bool between = p > 0 && p + 1 < planes && curvature > 0;
    result.planes[at] = float(p) + (between ? 0.5f * (before - after) / curvature : 0.0f);
    result.scores[at] = 1.0f - job.costs[(y * planes + p) * width + x] / float(COST_SCALE);
    result.contrasts[at] = (float(total[x]) / planes - here) / (PATHS * COST_SCALE);
  }
}

/// The planes of a reference camera's pixels.
inline void matching(const MatchingJob& job, const SweepResult& result, uint8_t* scratch) {
  const MatchingRows rows(job, scratch);
  const int64_t paths = 2 * SLANTS * job.planes * rows.across;
  memset(rows.paths, 0, paths);
  memset(rows.least, 0, 2 * SLANTS * rows.across);
  for (int64_t y = 0; y < job.height; ++y) {
    follow_both(job, rows, y);
    step_row(job, rows, y, 1, y % 2);
  }
  memset(rows.paths, 0, paths);
  memset(rows.least, 0, 2 * SLANTS * rows.across);
  for (int64_t y = job.height - 1; y >= 0; --y) {
    step_row(job, rows, y, -1, y % 2);
    choose_row(job, rows, result, y);
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
