// Arguments of the kernels that render: plain structures, mirrored field by field in
// kernels/cuda/jobs.py. Every kernel takes one of them by value, and nothing else.
//
// Arrays are untyped here so that one structure serves every number type T, which the kernel's
// template names; plain numbers are doubles, which hold any T exactly. What is absent is null.
#pragma once

#include "platform.h"
#include "splat_fields.h"

namespace gsfw {
namespace cuda {

/// Side of a tile in pixels: the unit of binning, and of one block of threads.
constexpr int TILE = 16;
constexpr int TILE_PIXELS = TILE * TILE;
/// The part of a tile that one warp blends: 8 x 4 pixels, two columns and four rows of them.
constexpr int SUBTILE_WIDTH = 8;
constexpr int SUBTILE_HEIGHT = 4;
constexpr int SUBTILES = TILE_PIXELS / WARP;

/// Sums over the pixels of a splat, with g = alpha dL/d alpha: g, g u, g v, g u^2, g u v,
/// g v^2; then weight times gradient for each channel, and if asked for the magnitudes of the
/// gradient of x and of y.
enum SumField { SUM_G, SUM_U, SUM_V, SUM_UU, SUM_UV, SUM_VV, SUM_CHANNELS };

/// Threads of a block of ``emit``, of ``find_tiles`` and of ``sum_counts``, and the places in the
/// order that each thread of the last one sums.
constexpr int BIN_THREADS = 256;
constexpr int COUNTS_PER_THREAD = 4;

/// Entries of a pose gradient: by rotation, by translation, and by the camera centre.
constexpr int POSE_FIELDS = 15;

/// The image and its tiles.
struct Grid {
  int width, height;
  int columns, rows;
};

/// One camera and the conventions of a render (``Camera`` and ``Settings`` of the shared maths).
struct View {
  /// T [4, 4] and T [3, 3], in device memory.
  const void* world_to_camera;
  const void* intrinsics;
  double jacobian_margin, dilation, compensation_min, alpha_min;
  double near, far, length_max, quaternion_min_norm;
  /// ``CameraModel``: 0 pinhole, 1 orthographic, 2 fisheye.
  int model;
  int antialias;
};

/// Splats as ``gsfw.core.splats.Splats`` has them.
struct SplatArrays {
  int64 count;
  /// T [n, 3], [n, 4], [n, 3]
  const void* means;
  const void* quats;
  const void* scales;
  /// T [n, 3, 3], instead of quats and scales.
  const void* covariances;
  /// T [n]
  const void* opacities;
  /// T [n, color_stride]: channels, or SH coefficients [k, 3], of which ``rest`` may have all but
  /// the constant ones: T [n, rest_stride], or, where there are ``offsets``, T [m, 3].
  const void* colors;
  const void* rest;
  /// int64 [n + 1], rising from 0 to m: row i has rows offsets[i] to offsets[i + 1] of ``rest``,
  /// each of one coefficient.
  const int64* offsets;
  /// m
  int64 rest_rows;
  /// T [n, extras]
  const void* extra;
  int color_stride, rest_stride, extras;
  /// Channels of colour: 3 for SH.
  int color_channels;
  /// 1 to render depth, 2 to render depth and a channel of ones.
  int depth_channels;
  int unused;
};

/// Gradients of ``SplatArrays``, laid out like them; null if not requested.
struct SplatGradients {
  void* means;
  void* quats;
  void* scales;
  void* covariances;
  void* opacities;
  void* colors;
  void* rest;
  void* extra;
};

/// project<T, Shape, DEGREE, RAGGED>: projected splats, and how many tiles each splat intersects.
struct ProjectJob {
  View view;
  SplatArrays splats;
  Grid grid;
  /// log2 of the least alpha that is rendered.
  double level_min;
  /// False when every splat in front is to reach the whole image.
  int bounded;
  /// Numbers of T per projected splat, a multiple of 4: those of ``SplatField``, the channels
  /// (colour, extra, depth, 1), and zeros.
  int stride;
  /// T [n, stride]; written where visible.
  void* projected;
  /// uint32 [n] for float, uint64 [n] for double: view depth as a number that sorts alike, all ones
  /// where not visible.
  void* depth_keys;
  /// int32 [n]: tiles intersected; 0 where not visible.
  int* tile_counts;
  /// [n]
  uint8* visible;
  /// T [n]: larger half side of the bounding box, in pixels; 0 where not visible.
  void* radii;
};

/// sum_counts<Count>: where each splat's pairs end.
struct CountsJob {
  /// Splats, all of them, visible ones first, from front to back: int32 [n].
  const int* order;
  int64 count;
  /// Count [n], by row.
  const void* tile_counts;
  /// int64 [n], by place in the order.
  int64* ends;
  /// The same by row; null where not wanted.
  int64* row_ends;
  /// The number of all pairs; 0 before the kernel.
  int64* pairs;
  /// The number that the next block takes, and [blocks] for looking back; 0 before the kernel.
  uint64* next;
  uint64* words;
};

/// emit<T, Key>: one pair per splat and tile, splat after splat from front to back.
struct EmitJob {
  Grid grid;
  int bounded;
  int stride;
  const void* projected;
  /// As in ``CountsJob``.
  const int* order;
  int64 count;
  /// int32 [n], by row.
  const int* tile_counts;
  const int64* ends;
  /// Key [p]: the tile of each pair.
  void* tiles;
  /// int32 [p]: the row of each pair, or, if ``numbered``, where the pair itself was written.
  int* payload;
  /// int32 [p], by where each pair was written: its row; null unless ``numbered``.
  int* rows;
  /// Pairs that there is room for; later ones are not written.
  int64 room;
  int numbered;
  int unused;
};

/// find_tiles<Key>: where the pairs and the checkpoints of each tile begin, once pairs are sorted by
/// tile.
struct TilesJob {
  const void* tiles;
  int64 count;
  /// See ``count_of``.
  const int64* counted;
  int num_tiles;
  /// Pairs of a chunk.
  int chunk;
  /// int64 [num_tiles + 1] each. A tile has a checkpoint for each of its chunks but the first.
  int64* starts;
  int64* chunk_starts;
  /// int32 [chunks], filled with -1.
  int* chunk_tiles;
  int64 chunks;
  /// The number that the next block takes, and [blocks] for looking back; 0 before the kernel.
  uint64* next;
  uint64* words;
};

/// blend<T, CHANNELS, CHUNK, MEASURE>: one image, and what its backward pass needs.
struct BlendJob {
  Grid grid;
  double level_min, alpha_cap, alpha_limit, transmittance_min;
  const void* projected;
  int stride;
  /// Channels rendered; CHANNELS may be more, which are then 0.
  int channels;
  int bounded;
  int unused;
  /// int32 [p]: the row of each pair, tile after tile, from front to back.
  const int* rows;
  /// int64 [tiles + 1]
  const int64* tile_starts;
  /// int64 [tiles + 1]: the first of each tile's rows in ``checkpoints``; a tile has one for each
  /// of its chunks but the first.
  const int64* chunk_starts;
  /// T [channels], behind everything.
  const void* background;
  /// T [h, w, channels]
  void* image;
  /// T [h, w]: 1 - remaining transmittance.
  void* alpha;
  /// T [h, w]: remaining transmittance.
  void* left;
  /// int32 [h, w]: how many pairs of its tile each pixel has looked at before it stopped.
  int* seen;
  /// T [chunks, 1 + CHANNELS, 256]: transmittance and colours in front of each chunk, pixels in the
  /// order of subtiles; null where there is no backward pass.
  void* checkpoints;
  /// int32 [chunks]: the tile of each checkpoint, -1 where the tile had stopped before.
  int* chunk_tiles;
  /// T [n], or T [p] if ``slots`` is given: sums of weights; null where not asked for.
  void* contribution;
  /// T [h, w]: what a pixel's weights count in these sums; null for ones.
  const void* pixel_weights;
  /// int32 [p]: where each pair was written when it was emitted; null unless numbered.
  const int* slots;
};

/// blend_backward<T, CHANNELS, CHUNK, THREADS, ABSOLUTE>: the sums that each splat's gradient is made
/// of.
struct BlendBackwardJob {
  BlendJob forward;
  /// T [h, w, channels]
  const void* image_gradient;
  /// T [h, w]; null for zeros.
  const void* alpha_gradient;
  /// Rows of ``checkpoints``.
  int64 chunks;
  /// T [n, sum_stride], added to in any order; or T [p, sum_stride], each written once, where the
  /// forward job has slots.
  void* sums;
  int sum_stride;
  int unused;
};

/// project_backward<T, Shape, DEGREE, RAGGED, POSE>: gradients of the splats and of the camera.
struct ProjectBackwardJob {
  ProjectJob forward;
  /// As BlendBackwardJob has them; the first slot of a splat that has many takes their sum.
  void* sums;
  int sum_stride;
  /// Channels rendered, after which the magnitudes of absgrad follow in ``sums``.
  int channels;
  /// int64 [n], by row: the end of each splat's slots, ``tile_counts`` of them; null where ``sums``
  /// has one row per splat.
  const int64* slot_ends;
  SplatGradients gradients;
  /// T [n] each; null where not wanted.
  void* screen_gradient;
  void* absgrad;
  /// T [blocks, POSE_FIELDS]: one sum per block of threads.
  void* pose;
  /// Add to the gradients (further cameras of a batch) instead of replacing them.
  int accumulate;
  int unused;
};

}  // namespace cuda
}  // namespace gsfw
