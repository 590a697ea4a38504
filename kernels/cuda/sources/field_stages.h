// Arguments of the kernels of temporal fields: plain structures, mirrored field by field in
// kernels/cuda/field_jobs.py.
//
// As in stages.h, arrays are untyped, plain numbers are doubles, and what is absent is null.
#pragma once

#include "platform.h"

namespace gsfw {
namespace cuda {

/// Threads of a block of ``plane_product`` and its backward pass, of which a warp has a place to
/// itself, and the most resolutions.
constexpr int PLANE_THREADS = 128;
constexpr int PLANE_LEVELS = 8;

/// Threads of a block of ``grid_variation``, ``grid_distance``, their backward passes and
/// ``add_penalty``, and the numbers of a block.
constexpr int GRID_THREADS = 256;
constexpr int GRID_NUMBERS = 4096;

/// Threads of a block of ``slice`` and its backward pass.
constexpr int SLICE_THREADS = 128;

/// Threads of a block of ``hash_features`` and its backward pass, and the most tables.
constexpr int HASH_THREADS = 128;
constexpr int HASH_LEVELS = 32;

/// Planes of one resolution.
struct PlaneLevel {
  /// T [3, side, side, channels]: planes xy, xz and yz.
  const void* planes;
  /// T [3, side, channels]: the time planes xt, yt and zt, read at one time.
  const void* lines;
  int side;
  int unused;
};

/// plane_product<T>: products of six interpolated features.
struct PlaneProductJob {
  /// The first ``level_count`` are there.
  PlaneLevel levels[PLANE_LEVELS];
  /// T [count, 3] in [-1, 1]; constant beyond.
  const void* places;
  int64 count;
  /// Factor of every product.
  double scale;
  int level_count;
  int channels;
  /// T [count, level_count * channels]
  void* features;
};

/// Where gradients of the planes of one resolution are added: null where they are not wanted.
struct PlaneGradients {
  void* planes;
  void* lines;
};

/// plane_product_backward<T>: gradients of the planes, which are added to what is there, and of
/// the places.
struct PlaneProductBackwardJob {
  /// Without features.
  PlaneProductJob forward;
  PlaneGradients levels[PLANE_LEVELS];
  /// T [count, level_count * channels]
  const void* gradient;
  /// T [count, 3]; null where it is not wanted.
  void* places;
};

/// Numbers of a grid that is penalised, and what a pass makes of them.
struct GridNumbers {
  /// T [count], less than 2^31.
  const void* values;
  int64 count;
  /// [blocks]: the parts of the penalty; of the forward pass.
  double* sums;
  /// T: the gradient of the penalty. T [count]: that of the numbers. Both of the backward pass.
  const void* arriving;
  void* gradient;
};

/// An axis along which neighbours are compared.
struct GridAxis {
  /// Cells along it, and numbers from a cell to the next.
  int cells, stride;
  /// Factor of the squared differences.
  double weight;
};

/// grid_variation<T> and grid_variation_backward<T>: squared differences of the cells of a grid
/// [outer, first, second, inner].
struct GridVariationJob {
  GridNumbers grid;
  GridAxis first, second;
  /// 1 for first differences along both axes, 2 for second differences along the first.
  int order;
  int unused;
};

/// grid_distance<T> and grid_distance_backward<T>: distances from a constant.
struct GridDistanceJob {
  GridNumbers grid;
  double center;
  /// Factor of every distance.
  double weight;
};

/// add_penalty<T>: the penalty, from its parts.
struct PenaltyJob {
  const double* sums;
  int64 blocks;
  /// T
  void* value;
};

/// slice<T>: slices of Gaussians of space and time.
struct SliceJob {
  /// T [count, 4]: left and right quaternions, wxyz, of any norm; scales along x, y, z, t.
  const void* left;
  const void* right;
  const void* scales;
  int64 count;
  /// T [count, 3, 3], [count, 3], [count]
  void* covariances;
  void* velocities;
  void* variances;
};

/// slice_backward<T>: from the gradients of slices to those of quaternions and scales.
struct SliceBackwardJob {
  /// Without slices.
  SliceJob forward;
  const void* covariances;
  const void* velocities;
  const void* variances;
  void* left;
  void* right;
  void* scales;
};

/// A table of a hash grid.
struct HashLevel {
  /// T [rows, channels]
  const void* table;
  /// Less than 2^31, and a power of two unless ``dense``.
  int64 rows;
  /// Corners of cells along each axis of space, and along time; at least 2.
  int side, times;
  /// Each corner has a row of its own.
  int dense;
  int unused;
};

/// hash_features<T, WIDTH>: interpolated rows of tables. ``WIDTH`` divides the channels, and arrays
/// begin at multiples of so many numbers.
struct HashJob {
  /// The first ``level_count`` are there.
  HashLevel levels[HASH_LEVELS];
  /// T [count, 3] in [-1, 1], and T in [0, 1]; constant beyond.
  const void* places;
  const void* time;
  int64 count;
  int level_count, channels;
  /// T [count, level_count * channels], less than 2^31 numbers.
  void* features;
};

/// hash_features_backward<T, WIDTH>: gradients of tables, which are added to what is there.
struct HashBackwardJob {
  /// Without features.
  HashJob forward;
  /// T [count, level_count * channels]
  const void* gradient;
  /// T [rows, channels] each; null where it is not wanted.
  void* tables[HASH_LEVELS];
};

}  // namespace cuda
}  // namespace gsfw
