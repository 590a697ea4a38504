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

template <typename T>
GSFW_FUNCTION void start_tile_backward(const BlendBackwardJob<T>& job, const TilePlace& place,
                                       const BackwardState<T>& state) {
  const int channels = job.forward.channels;
  const T* background = job.forward.background;
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
  Pack<T> shape[SLOT_CHANNELS];
  Pack<T> channel[CHANNELS ? CHANNELS : 1];
  Pack<T> magnitude[2];
};

/// Take one splat at one block: adds to ``sums`` and moves ``behind`` in front of the splat.
template <typename T, int CHANNELS, bool ABSOLUTE>
GSFW_FUNCTION void backward_block(const BlendBackwardJob<T>& job, const T* splat, int b,
                                 const Pack<T>& alpha, const Pack<T>& weight,
                                 const BackwardState<T>& state, Sums<T, CHANNELS>& sums,
                                 T* channel_sums) {
  const int channels = CHANNELS ? CHANNELS : job.forward.channels;
  const T* image = state.image + b * channels * LANES;
  const T* color = splat + SPLAT_CHANNELS;
  Pack<T> pull = Pack<T>(color[0]) * load(image);
  for (int c = 1; c < channels; ++c) pull = fma(Pack<T>(color[c]), load(image + c * LANES), pull);
  const Pack<T> behind = load(state.behind + b * LANES);
  const Pack<T> lift = pull - behind;
  store(state.behind + b * LANES, fma(alpha, lift, behind));
  const Pack<T> g = keep(alpha <= Pack<T>(job.forward.cut_offs.alpha_limit), weight * lift);
  for (int c = 0; c < CHANNELS; ++c) {
    sums.channel[c] = fma(weight, load(image + c * LANES), sums.channel[c]);
  }
  for (int c = 0; CHANNELS == 0 && c < channels; ++c) {
    T* at = channel_sums + c * LANES;
    store(at, fma(weight, load(image + c * LANES), load(at)));
  }
  const Whitened<T> at =
      whitened(splat, load(PixelTables<T>::pixels.x[b]), load(PixelTables<T>::pixels.y[b]));
  const Pack<T> gu = g * at.u, gv = g * at.v;
  sums.shape[SLOT_G] = sums.shape[SLOT_G] + g;
  sums.shape[SLOT_U] = sums.shape[SLOT_U] + gu;
  sums.shape[SLOT_V] = sums.shape[SLOT_V] + gv;
  sums.shape[SLOT_UU] = fma(gu, at.u, sums.shape[SLOT_UU]);
  sums.shape[SLOT_UV] = fma(gu, at.v, sums.shape[SLOT_UV]);
  sums.shape[SLOT_VV] = fma(gv, at.v, sums.shape[SLOT_VV]);
  if (ABSOLUTE) {
    const Pack<T> across = fma(Pack<T>(splat[SPLAT_R]), gu, Pack<T>(splat[SPLAT_WK]) * gv);
    sums.magnitude[0] = sums.magnitude[0] + absolute(across);
    sums.magnitude[1] = sums.magnitude[1] + absolute(Pack<T>(splat[SPLAT_W]) * gv);
  }
}

template <typename T, int CHANNELS, bool ABSOLUTE>
GSFW_FUNCTION void write_slot(const Sums<T, CHANNELS>& sums, const T* channel_sums, int channels,
                              T* slot) {
  if (CHANNELS == 3) {
    Pack<T> eight[8];
    for (int k = 0; k < SLOT_CHANNELS; ++k) eight[k] = sums.shape[k];
    eight[6] = sums.channel[0];
    eight[7] = sums.channel[1 % (CHANNELS ? CHANNELS : 1)];
    sum_eight(eight, slot);
    slot[8] = sum(sums.channel[2 % (CHANNELS ? CHANNELS : 1)]);
  } else {
    for (int k = 0; k < SLOT_CHANNELS; ++k) slot[k] = sum(sums.shape[k]);
    for (int c = 0; c < channels; ++c) {
      slot[SLOT_CHANNELS + c] = sum(load(channel_sums + c * LANES));
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
  const Pack<T> zero(T(0));
  int next[BLOCKS];
  for (int b = 0; b < BLOCKS; ++b) next[b] = state.starts[b] + state.rendered[b];
  for (int i = chunk.count - 1; i >= 0; --i) {
    const T* splat = chunk.projected + i * job.forward.stride;
    Sums<T, CHANNELS> sums;
    for (int k = 0; k < SLOT_CHANNELS; ++k) sums.shape[k] = zero;
    for (int c = 0; c < CHANNELS; ++c) sums.channel[c] = zero;
    for (int k = 0; k < 2; ++k) sums.magnitude[k] = zero;
    for (int c = 0; CHANNELS == 0 && c < channels; ++c) store(channel_sums + c * LANES, zero);
    for (uint32_t rest = chunk.blocks[i]; rest; rest &= rest - 1) {
      const int b = __builtin_ctz(rest);
      const int64_t at = int64_t(--next[b]) * LANES;
      backward_block<T, CHANNELS, ABSOLUTE>(job, splat, b, load(state.alphas + at),
                                           load(state.weights + at), state, sums, channel_sums);
    }
    write_slot<T, CHANNELS, ABSOLUTE>(sums, channel_sums, channels,
                                      job.slots + int64_t(entries[i].slot) * job.slot_stride);
  }
}

/// Working memory of one thread, in numbers of T.
template <typename T>
GSFW_FUNCTION int64_t blend_backward_scratch(int stride, int channels) {
  return blend_scratch<T>(stride, channels) + PIXELS * (1 + channels) +
         2 * int64_t(CHUNK + UNROLL) * BLOCKS * LANES + (channels + 2) * LANES;
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
    T* slot = job.slots + int64_t(forward.entries[at].slot) * job.slot_stride;
    for (int k = 0; k < job.slot_stride; ++k) slot[k] = T(0);
  }
  if (rendered > 0) start_tile_backward(job, place, state);
  for (int64_t c = rendered - 1; c >= 0; --c) {
    const int64_t first = start + c * CHUNK;
    const Entry* entries = forward.entries + first;
    load_chunk(forward, place, entries, int(end - first < CHUNK ? end - first : CHUNK), chunk);
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
