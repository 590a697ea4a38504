// Blend, backward: from the gradient of an image to the sums that each splat's gradient is made of.
//
// A chunk is replayed from its checkpoint to get every alpha and weight back, and then taken from
// back to front. With w = alpha T and p = sum over channels of colour times gradient, let B be what
// the pixel's gradient sees behind a splat, as if nothing were in front of it: then
//
//     alpha dL/d alpha = w (p - B),    and in front of the splat    B' = B + alpha (p - B),
//
// which needs no division by 1 - alpha and no transmittance recovered from behind; B starts from
// the gradient of the remaining transmittance.
#pragma once

#include "blend.h"

namespace gsfw {
namespace GSFW_ISA {

/// Entries before a slot is written that its memory is asked for.
constexpr int SLOTS_AHEAD = 8;

/// State of one tile in the backward pass.
template <typename T>
struct BackwardState {
  /// [PIXELS]: B.
  T* behind;
  /// [BLOCKS, channels, LANES]: gradient of the blended channels.
  T* image;
  /// [CHUNK * BLOCKS, LANES] each, block after block: what the replay found.
  T* alphas;
  T* weights;
  /// First element of each block's part, and the rendered part of it.
  int starts[BLOCKS];
  int rendered[BLOCKS];
};

/// Read the gradient of one block of a whole tile: four rows of four pixels of three channels.
template <typename T>
GSFW_FUNCTION void start_rgb_block(const BlendBackwardJob<T>& job, const TilePlace& place, int b,
                                   const BackwardState<T>& state) {
  T pixels[3 * LANES], alpha[LANES];
  int64_t at = int64_t(place.y + b / TILE_BLOCKS * BLOCK) * job.forward.grid.width + place.x +
               b % TILE_BLOCKS * BLOCK;
  for (int y = 0; y < BLOCK; ++y, at += job.forward.grid.width) {
    memcpy(pixels + y * BLOCK * 3, job.image_gradient + at * 3, BLOCK * 3 * sizeof(T));
    if (job.alpha_gradient) {
      memcpy(alpha + y * BLOCK, job.alpha_gradient + at, BLOCK * sizeof(T));
    }
  }
  Pack<T> gradient[3];
  load_rows<3>(pixels, LANES, gradient);
  Pack<T> behind = job.alpha_gradient ? -load(alpha) : Pack<T>(T(0));
  for (int c = 0; c < 3; ++c) {
    store(state.image + (b * 3 + c) * LANES, gradient[c]);
    behind = behind + Pack<T>(job.forward.background[c]) * gradient[c];
  }
  store(state.behind + b * LANES, behind);
}

template <typename T>
GSFW_FUNCTION void start_tile_backward(const BlendBackwardJob<T>& job, const TilePlace& place,
                                       const BackwardState<T>& state) {
  const int channels = job.forward.channels;
  const T* background = job.forward.background;
  if (channels == 3 && place.width == TILE && place.height == TILE) {
    for (int b = 0; b < BLOCKS; ++b) start_rgb_block(job, place, b, state);
    return;
  }
  for (int i = 0; i < PIXELS * channels; ++i) state.image[i] = T(0);
  for (int i = 0; i < PIXELS; ++i) state.behind[i] = T(0);
  for (int y = 0; y < place.height; ++y) {
    const int64_t row = int64_t(place.y + y) * job.forward.grid.width + place.x;
    for (int x = 0; x < place.width; ++x) {
      const int at = block_position(x, y);
      const T* gradient = job.image_gradient + (row + x) * channels;
      T* to = state.image + at / LANES * channels * LANES + at % LANES;
      T behind = job.alpha_gradient ? -job.alpha_gradient[row + x] : T(0);
      for (int c = 0; c < channels; ++c) {
        to[c * LANES] = gradient[c];
        behind = behind + background[c] * gradient[c];
      }
      state.behind[at] = behind;
    }
  }
}

/// Get alphas and weights of one block back; returns how many of its list were rendered.
template <typename T>
GSFW_FUNCTION int replay_block(const BlendJob<T>& job, const Chunk<T>& chunk, int b,
                               const T* checkpoint, T* alphas, T* weights) {
  const CutOffs<T> cut = job.cut_offs;
  const Pack<T> x = load(PixelTables<T>::pixels.x[b]), y = load(PixelTables<T>::pixels.y[b]);
  const Pack<T> stop(cut.transmittance_min), one(T(1));
  Pack<T> transmittance = load(checkpoint + b * LANES);
  if (!any(transmittance > stop)) return 0;
  const uint16_t* list = chunk.lists + b * LIST;
  const int length = chunk.lengths[b];
  int k = 0;
  for (bool open = true; k < length && open; k += UNROLL) {
    Pack<T> alpha[UNROLL];
    for (int j = 0; j < UNROLL; ++j) {
      alpha[j] = alpha_of(chunk.projected + list[k + j] * job.stride, x, y, cut);
    }
    for (int j = 0; j < UNROLL; ++j) {
      const Pack<T> weight = alpha[j] * transmittance;
      transmittance = transmittance * (one - alpha[j]);
      const LaneMask<T> rendered = transmittance > stop;
      store(alphas + (k + j) * LANES, keep(rendered, alpha[j]));
      store(weights + (k + j) * LANES, keep(rendered, weight));
    }
    open = any(transmittance > stop);
  }
  return k < length ? k : length;
}

/// Sums over a splat's pixels, lane by lane: those of ``SlotField``, then two magnitudes.
template <typename T, int CHANNELS>
struct Sums {
  Part<T> shape[SLOT_CHANNELS];
  Part<T> channel[CHANNELS ? CHANNELS : 1];
  Part<T> magnitude[2];
};

/// Take one splat at the pixels from ``pixel`` on of a tile that is stored block after block; the
/// replay found ``alpha`` and ``weight``. Adds to ``sums`` and moves ``behind`` in front of it.
template <typename T, int CHANNELS, bool ABSOLUTE>
GSFW_FUNCTION void backward_part(const BlendBackwardJob<T>& job, const T* splat, int pixel,
                                 const T* alphas, const T* weights,
                                 const BackwardState<T>& state, Sums<T, CHANNELS>& sums,
                                 T* channel_sums) {
  using N = Part<T>;
  const int channels = CHANNELS ? CHANNELS : job.forward.channels;
  const T* image = state.image + pixel / LANES * channels * LANES + pixel % LANES;
  const T* color = splat + SPLAT_CHANNELS;
  const N alpha = load_part(alphas), weight = load_part(weights);
  N pull = N(color[0]) * load_part(image);
  for (int c = 1; c < channels; ++c) pull = fma(N(color[c]), load_part(image + c * LANES), pull);
  const N behind = load_part(state.behind + pixel);
  const N lift = pull - behind;
  store(state.behind + pixel, fma(alpha, lift, behind));
  const N g = keep(alpha <= N(job.forward.cut_offs.alpha_limit), weight * lift);
  for (int c = 0; c < CHANNELS; ++c) {
    sums.channel[c] = fma(weight, load_part(image + c * LANES), sums.channel[c]);
  }
  for (int c = 0; CHANNELS == 0 && c < channels; ++c) {
    T* at = channel_sums + c * LANES;
    store(at, fma(weight, load_part(image + c * LANES), load_part(at)));
  }
  const Whitened<N> at = whitened(splat, load_part(PixelTables<T>::pixels.x[0] + pixel),
                                  load_part(PixelTables<T>::pixels.y[0] + pixel));
  const N gu = g * at.u, gv = g * at.v;
  sums.shape[SLOT_G] = sums.shape[SLOT_G] + g;
  sums.shape[SLOT_U] = sums.shape[SLOT_U] + gu;
  sums.shape[SLOT_V] = sums.shape[SLOT_V] + gv;
  sums.shape[SLOT_UU] = fma(gu, at.u, sums.shape[SLOT_UU]);
  sums.shape[SLOT_UV] = fma(gu, at.v, sums.shape[SLOT_UV]);
  sums.shape[SLOT_VV] = fma(gv, at.v, sums.shape[SLOT_VV]);
  if (ABSOLUTE) {
    const N across = fma(N(splat[SPLAT_R]), gu, N(splat[SPLAT_WK]) * gv);
    sums.magnitude[0] = sums.magnitude[0] + absolute(across);
    sums.magnitude[1] = sums.magnitude[1] + absolute(N(splat[SPLAT_W]) * gv);
  }
}

template <typename T, int CHANNELS, bool ABSOLUTE>
GSFW_FUNCTION void write_slot(const Sums<T, CHANNELS>& sums, const T* channel_sums, int channels,
                              T* slot) {
  if (CHANNELS == 3) {
    Part<T> eight[8];
    for (int k = 0; k < SLOT_CHANNELS; ++k) eight[k] = sums.shape[k];
    eight[6] = sums.channel[0];
    eight[7] = sums.channel[1 % (CHANNELS ? CHANNELS : 1)];
    sum_eight(eight, slot);
    slot[8] = sum(sums.channel[2 % (CHANNELS ? CHANNELS : 1)]);
  } else {
    for (int k = 0; k < SLOT_CHANNELS; ++k) slot[k] = sum(sums.shape[k]);
    for (int c = 0; c < channels; ++c) {
      slot[SLOT_CHANNELS + c] = sum(load_part(channel_sums + c * LANES));
    }
  }
  if (ABSOLUTE) {
    slot[SLOT_CHANNELS + channels] = sum(sums.magnitude[0]);
    slot[SLOT_CHANNELS + channels + 1] = sum(sums.magnitude[1]);
  }
}

/// Replay all blocks of a chunk; afterwards ``chunk.blocks`` has only the bits that were rendered.
template <typename T>
GSFW_FUNCTION void replay_chunk(const BlendJob<T>& job, Chunk<T>& chunk, const T* checkpoint,
                                BackwardState<T>& state) {
  int start = 0;
  for (int b = 0; b < BLOCKS; ++b) {
    state.starts[b] = start;
    T* alphas = state.alphas + int64_t(start) * LANES;
    T* weights = state.weights + int64_t(start) * LANES;
    state.rendered[b] = replay_block(job, chunk, b, checkpoint, alphas, weights);
    const uint16_t* list = chunk.lists + b * LIST;
    for (int k = state.rendered[b]; k < chunk.lengths[b]; ++k) chunk.blocks[list[k]] &= ~(1u << b);
    start += state.rendered[b] + UNROLL;
  }
}

template <typename T, int CHANNELS, bool ABSOLUTE>
GSFW_FUNCTION void backward_chunk(const BlendBackwardJob<T>& job, const Chunk<T>& chunk,
                                 const Entry* entries, BackwardState<T>& state, T* channel_sums) {
  const int channels = CHANNELS ? CHANNELS : job.forward.channels;
  const Part<T> zero(T(0));
  int next[BLOCKS];
  for (int b = 0; b < BLOCKS; ++b) next[b] = state.starts[b] + state.rendered[b];
  const auto slot_of = [&](int i) { return job.slots + int64_t(entries[i].slot) * job.slot_stride; };
  for (int i = chunk.count - 1; i >= 0; --i) {
    if (i >= SLOTS_AHEAD) {
      // Slots lie in the order of the model, which is none in the image.
      __builtin_prefetch(slot_of(i - SLOTS_AHEAD), 1);
      __builtin_prefetch(slot_of(i - SLOTS_AHEAD) + job.slot_stride - 1, 1);
    }
    const T* splat = chunk.projected + i * job.forward.stride;
    Sums<T, CHANNELS> sums;
    for (int k = 0; k < SLOT_CHANNELS; ++k) sums.shape[k] = zero;
    for (int c = 0; c < CHANNELS; ++c) sums.channel[c] = zero;
    for (int k = 0; k < 2; ++k) sums.magnitude[k] = zero;
    for (int c = 0; CHANNELS == 0 && c < channels; ++c) store(channel_sums + c * LANES, zero);
    for (uint32_t rest = chunk.blocks[i]; rest; rest &= rest - 1) {
      const int b = __builtin_ctz(rest);
      const int64_t at = int64_t(--next[b]) * LANES;
      for (int lane = 0; lane < LANES; lane += PART_LANES<T>) {
        backward_part<T, CHANNELS, ABSOLUTE>(job, splat, b * LANES + lane, state.alphas + at + lane,
                                             state.weights + at + lane, state, sums, channel_sums);
      }
    }
    write_slot<T, CHANNELS, ABSOLUTE>(sums, channel_sums, channels, slot_of(i));
  }
}

/// Working memory of one thread, in numbers of T.
template <typename T>
GSFW_FUNCTION int64_t blend_backward_scratch(int stride, int channels) {
  return blend_scratch<T>(stride, channels) + PIXELS * (1 + channels) +
         2 * int64_t(CHUNK + UNROLL) * BLOCKS * LANES + (channels + 2) * LANES;
}

/// The first entry of the chunk that a tile's backward pass begins with.
template <typename T>
GSFW_FUNCTION const Entry* first_taken(const BlendJob<T>& job, int tile) {
  if (tile >= job.grid.columns * job.grid.rows) return job.entries + job.tile_starts[tile];
  const int64_t last = job.chunks_blended[tile] > 0 ? job.chunks_blended[tile] - 1 : 0;
  return job.entries + job.tile_starts[tile] + last * CHUNK;
}

template <typename T, int CHANNELS, bool ABSOLUTE>
void blend_tile_backward(const BlendBackwardJob<T>& job, int tile, T* scratch) {
  const BlendJob<T>& forward = job.forward;
  const TilePlace place = place_of(forward.grid, tile);
  Chunk<T> chunk;
  scratch = take_chunk(scratch, forward.stride, chunk);
  constexpr int64_t REPLAYED = int64_t(CHUNK + UNROLL) * BLOCKS * LANES;
  BackwardState<T> state;
  state.behind = scratch;
  state.image = state.behind + PIXELS;
  state.alphas = state.image + PIXELS * forward.channels;
  state.weights = state.alphas + REPLAYED;
  T* channel_sums = state.weights + REPLAYED;
  const int64_t start = forward.tile_starts[tile], end = forward.tile_starts[tile + 1];
  const int64_t rendered = forward.chunks_blended[tile];
  for (int64_t at = start + rendered * CHUNK; at < end; ++at) {
    if (at + SLOTS_AHEAD < end) {
      __builtin_prefetch(job.slots +
                         int64_t(forward.entries[at + SLOTS_AHEAD].slot) * job.slot_stride, 1);
    }
    T* slot = job.slots + int64_t(forward.entries[at].slot) * job.slot_stride;
    for (int k = 0; k < job.slot_stride; ++k) slot[k] = T(0);
  }
  if (rendered > 0) start_tile_backward(job, place, state);
  const Entry* next_tile = first_taken(forward, tile + 1);
  for (int64_t c = rendered - 1; c >= 0; --c) {
    const int64_t first = start + c * CHUNK;
    const Entry* entries = forward.entries + first;
    const int count = int(end - first < CHUNK ? end - first : CHUNK);
    load_chunk(forward, place, entries, count, c > 0 ? entries - CHUNK : next_tile, chunk);
    const T* checkpoint = forward.checkpoints + (forward.chunk_starts[tile] + c) * PIXELS;
    replay_chunk(forward, chunk, checkpoint, state);
    backward_chunk<T, CHANNELS, ABSOLUTE>(job, chunk, entries, state, channel_sums);
  }
}

/// Fill the slots of all entries of tile number ``tile``.
template <typename T>
void blend_backward(const BlendBackwardJob<T>& job, int tile, T* scratch) {
  const bool rgb = job.forward.channels == 3;
  if (rgb && !job.absolute) return blend_tile_backward<T, 3, false>(job, tile, scratch);
  if (rgb) return blend_tile_backward<T, 3, true>(job, tile, scratch);
  if (!job.absolute) return blend_tile_backward<T, 0, false>(job, tile, scratch);
  blend_tile_backward<T, 0, true>(job, tile, scratch);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
