// Arguments of the kernels of a training step besides rendering: plain structures, mirrored
// field by field in kernels/cuda/step_jobs.py.
//
// As in stages.h, arrays are untyped, plain numbers are doubles, and what is absent is null.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

/// Pixels of an image that one block of ``ssim`` and ``ssim_backward`` answers for.
constexpr int SSIM_WIDTH = 32;
constexpr int SSIM_HEIGHT = 16;
constexpr int SSIM_THREADS = 256;
/// Maps of what flows back from a similarity to the images that were compared.
constexpr int SSIM_FLOWS = 3;
/// Sums of a block of ``ssim``: |x - y|, 1 - SSIM, and pixels that count.
constexpr int SSIM_SUMS = 3;

/// Threads of a block of ``adam``, the numbers each of them steps, and the tables of a launch.
constexpr int ADAM_THREADS = 256;
constexpr int ADAM_NUMBERS = 4;
constexpr int ADAM_TABLES = 16;

/// Threads of a block of ``check_finite``, the numbers of a block, and the tensors of a launch.
constexpr int FINITE_THREADS = 256;
constexpr int FINITE_NUMBERS = 8192;
constexpr int FINITE_TENSORS = 16;

/// Threads of a block of ``neighbors``, which read as many points at once.
constexpr int NEIGHBOR_THREADS = 256;

/// Images that are compared.
struct Comparison {
  /// T [c, h, w, d], and so is the target.
  const void* rendered;
  const void* target;
  /// [c, h, w]: 1 where a pixel counts and 0 elsewhere; null when all do.
  const uint8* valid;
  int images, height, width, channels;
};

/// ssim<T>: L1 and 1 - SSIM, summed over each block's pixels that count.
struct SsimJob {
  Comparison images;
  /// T [c, d, SSIM_FLOWS, h, w]: a quarter of the derivatives of SSIM with respect to the blurred
  /// u = x + y, and half of those with respect to the blurred u^2 and v^2, v = x - y; 0 where a
  /// pixel does not count. Null where there is no backward pass.
  void* flows;
  /// [SSIM_SUMS, blocks]
  double* sums;
};

/// add_losses<T>: the two losses from the sums of ``ssim``.
struct LossesJob {
  const double* sums;
  int64 blocks;
  int64 channels;
  /// T each: mean of |x - y|; mean of 1 - SSIM; the share of one number in either mean.
  void* l1;
  void* dissimilarity;
  void* share;
};

/// ssim_backward<T>: the gradient of the rendered images.
struct SsimBackwardJob {
  Comparison images;
  const void* flows;
  /// T each: ``LossesJob``'s share, and the gradients of the two losses.
  const void* share;
  const void* l1_gradient;
  const void* dissimilarity_gradient;
  /// T [c, h, w, d]
  void* gradient;
};

/// Rows that may lie apart: row r begins ``stride`` numbers after row r - 1.
struct AdamRows {
  void* numbers;
  int64 stride;
};

/// What a step of Adam does to one table of numbers.
struct AdamTable {
  AdamRows values, gradient, first, second;
  /// int64 [count]: the rows to step; null for all of them in order.
  const int64* rows;
  int64 count;
  /// Numbers of a row, less than 2^31.
  int64 width;
  double rate;
  /// Where the rate is, if the host does not know it; else null.
  const double* rate_at;
  /// Steps taken.
  double* steps;
  /// The block of ``adam`` that begins with this table.
  int first_block;
  /// All rows are stepped, and nothing lies between them.
  int whole;
  /// All four arrays begin at multiples of 16 bytes.
  int aligned;
  int unused;
};

/// begin_adam<T>, one thread per table: one step more, and the corrections of bias that belong to
/// it. Then adam<T>: the step of all tables.
struct AdamJob {
  /// The first ``count`` are there.
  AdamTable tables[ADAM_TABLES];
  double beta1, beta2, epsilon;
  /// Larger gradients count as this.
  double gradient_limit;
  /// 0 where this step does not count.
  const uint8* finite;
  /// T [count, 2]: the rate over the correction of the first moments, and 1 over that of the second.
  void* scales;
  int count;
  int unused;
};

/// check_finite<T>: a flag falls where any number of some tensors is infinite or NaN.
struct FiniteJob {
  /// T [counts[i]] each, at multiples of 16 bytes where ``aligned``.
  const void* numbers[FINITE_TENSORS];
  int64 counts[FINITE_TENSORS];
  /// The block that begins with each tensor: tensor i has blocks [first_blocks[i],
  /// first_blocks[i + 1]); tensors that are not there have none.
  int first_blocks[FINITE_TENSORS];
  int aligned;
  int unused;
  /// 1 before the kernel starts.
  uint8* finite;
};

/// neighbors<T, AXES, WIDTH>, one thread per point: the rows of the ``wanted`` nearest others, at most
/// WIDTH, nearest first; its own where there are fewer.
struct NeighborsJob {
  /// T [count, AXES].
  const void* points;
  /// [count, wanted].
  int64* rows;
  int count, wanted;
  /// Rows [first, end) are found.
  int first, end;
};

}  // namespace cuda
}  // namespace gsfw
