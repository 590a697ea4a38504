// Data between the stages of rendering: plain structures, the same in every translation
// unit, and one table of functions per instruction set and type.
#pragma once

#include <stdint.h>

#include "splat_fields.h"

namespace gsfw {

/// Side of a tile in pixels: the unit of binning and of threads.
constexpr int TILE = 16;
/// Side of a block in pixels: sixteen pixels that one pack holds.
constexpr int BLOCK = 4;
/// Blocks along the side of a tile, and blocks and pixels of a tile.
constexpr int TILE_BLOCKS = TILE / BLOCK;
constexpr int BLOCKS = TILE_BLOCKS * TILE_BLOCKS;
constexpr int PIXELS = TILE * TILE;
/// Entries of a tile that are blended between two checkpoints of the transmittance.
constexpr int CHUNK = 256;
/// Rows of the model that are one task of projection.
constexpr int ROWS_PER_TASK = 1024;
/// Pixels, and 1/100 of it per pixel of extent, by which rounding may not shrink an ellipse.
constexpr double SLACK = 1e-3;

/// Sums of a slot over the pixels of one entry, with g = alpha dL/d alpha: g, g u, g v, g u^2, g
/// u v, g v^2, then weight times gradient for each channel, and if asked for the magnitudes of the
/// gradient of x and y.
enum SlotField { SLOT_G, SLOT_U, SLOT_V, SLOT_UU, SLOT_UV, SLOT_VV, SLOT_CHANNELS };

/// One splat in one tile.
struct Entry {
  uint32_t row;
  /// Slot of its gradient: the slots of a row follow one another, and those of the next row them.
  uint32_t slot;
  /// Bit b: the splat reaches block b of the tile.
  uint32_t blocks;
};

/// Splats in tiles before the tiles are sorted, one splat after the other: the tile's number, and
/// the blocks of it as ``Entry`` has them.
struct Intersections {
  uint32_t* tiles;
  uint16_t* blocks;
};

struct Grid {
  int width, height;
  int columns, rows;
};

template <typename T>
struct CutOffs {
  /// log2 of the least alpha that is rendered.
  T level_min;
  /// Alpha is clamped here, and its gradient is 0 where it exceeds the limit.
  T alpha_cap, alpha_limit;
  T transmittance_min;
};

/// One image while it is blended.
template <typename T>
struct BlendJob {
  Grid grid;
  CutOffs<T> cut_offs;
  const T* projected;
  int stride;
  int channels;
  const Entry* entries;
  /// [tiles + 1]
  const int64_t* tile_starts;
  /// [tiles]: the tile's first row in ``checkpoints``.
  const int64_t* chunk_starts;
  /// [chunks, 256]: transmittance in front of each chunk.
  T* checkpoints;
  /// [tiles]: chunks that were rendered before the tile became opaque.
  int32_t* chunks_blended;
  /// [channels], behind everything.
  const T* background;
  /// [h, w, channels]
  T* image;
  /// [h, w]: 1 - remaining transmittance.
  T* alpha;
  /// [slots]: the sum of weights of each entry; null when not asked for.
  T* contribution;
  /// [h, w]: what a pixel's weights count in that sum; null for ones.
  const T* pixel_weights;
};

template <typename T>
struct BlendBackwardJob {
  BlendJob<T> forward;
  /// [h, w, channels]
  const T* image_gradient;
  /// [h, w]; null for zeros.
  const T* alpha_gradient;
  /// [slots, slot_stride]
  T* slots;
  int slot_stride;
  bool absolute;
};

template <typename T>
struct BinJob {
  Grid grid;
  /// False when every splat is to reach the whole image.
  bool bounded;
  /// [ranks]: rows of visible splats, from front to back.
  const uint32_t* order;
  int64_t ranks;
  /// [n, stride]
  const T* projected;
  int stride;
  /// [n]: how many tiles each visible row intersects.
  uint32_t* counts;
};

/// One camera and the conventions of a render, as ``Camera`` and ``Settings`` of the shared maths.
template <typename T>
struct ViewParameters {
  /// [3, 4]: rotation and translation from scene to camera.
  T world_to_camera[12];
  T focal_x, focal_y, principal_x, principal_y;
  int width, height;
  /// ``CameraModel``: 0 pinhole, 1 orthographic, 2 fisheye.
  int model;
  T jacobian_margin, dilation, compensation_min, alpha_min, near, far, length_max;
  T quaternion_min_norm;
  bool antialias;
};

/// Splats as ``gsfw.core.splats.Splats`` has them; what is absent is null.
template <typename T>
struct SplatArrays {
  int64_t count;
  /// [n, 3]
  const T* means;
  /// [n, 4]
  const T* quats;
  /// [n, 3]
  const T* scales;
  /// [n, 3, 3]
  const T* covariances;
  /// [n]
  const T* opacities;
  /// [n, color_stride]: ``colors`` channels, or the constant SH coefficients when ``sh_degree`` >=
  /// 0, followed by the others unless ``rest`` has them.
  const T* colors;
  int color_stride;
  int sh_degree;
  /// [n, rest_stride], or, where there are ``offsets``, [m, 3].
  const T* rest;
  int rest_stride;
  /// [n + 1], rising from 0 to m: row i has rows offsets[i] to offsets[i + 1] of ``rest``, each of
  /// one coefficient; null where all rows have equally many.
  const int64_t* offsets;
  /// [n, extras]
  const T* extra;
  int extras;
  /// Channels of colour: 3 for SH.
  int color_channels;
  /// 1 to render depth, 2 to render depth and a channel of ones, after all other channels.
  int depth_channels;
};

/// Gradients of ``SplatArrays``, laid out like them; null if not requested.
template <typename T>
struct SplatGradients {
  T* means;
  T* quats;
  T* scales;
  T* covariances;
  T* opacities;
  T* colors;
  T* rest;
  T* extra;
};

template <typename T>
struct ProjectJob {
  ViewParameters<T> view;
  SplatArrays<T> splats;
  T level_min;
  /// [n, stride] and [n]; written for visible rows only.
  T* projected;
  int stride;
  T* depths;
  /// [n]
  uint8_t* visible;
  /// [n]: larger half side of the bounding box, in pixels.
  T* radii;
};

/// Number of entries of a pose gradient: rotation, translation and camera centre.
constexpr int POSE_FIELDS = 15;

template <typename T>
struct ProjectBackwardJob {
  ProjectJob<T> forward;
  /// [n + 1]: the first slot of each row, and one behind the last.
  const uint32_t* slot_starts;
  /// [slots, slot_stride]
  const T* slots;
  int slot_stride;
  bool absolute;
  SplatGradients<T> gradients;
  /// Add to the gradients (further cameras of a batch) instead of replacing them.
  bool accumulate;
  /// [tasks, POSE_FIELDS]; null where not wanted.
  T* pose;
  /// [n] each; null where not wanted.
  T* screen_gradient;
  T* absgrad;
};

}  // namespace gsfw
