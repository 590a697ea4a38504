// L1 and SSIM of images, and the backward pass.
//
// Wang et al. 2004, equation 13, with zero padding. With u = x + y and v = x - y
//     SSIM = (A - B + 2 c1) (U - V + 2 c2) / ((A + B + 2 c1) (U + V + 2 c2)),
// where A and B are the squared window means of u and v, and U and V their variances: four blurred
// maps instead of five, and 1 - SSIM loses no digits where the images agree, for then v, B and V
// vanish. A block answers for a tile of pixels, one channel after another: it takes the tile with a
// border into shared memory, blurs it across into registers, puts that in place of what it took,
// and blurs down. Sums are made in an order that depends on the size of the images only.
#include "step_stages.h"

#include "block_sum.h"

namespace gsfw {
namespace cuda {

/// Taps of the window on one side, and all of them.
constexpr int REACH = 5, TAPS = 2 * REACH + 1;
/// c1 and c2 for data in [0, 1].
constexpr double C1 = 0.01 * 0.01, C2 = 0.03 * 0.03;
/// A tile with its border, and how far apart its rows lie. Distances are odd, so that the threads
/// of a warp, which blur across in different rows, read different banks.
constexpr int ROWS = SSIM_HEIGHT + 2 * REACH, COLUMNS = SSIM_WIDTH + 2 * REACH;
constexpr int TAKEN_PITCH = COLUMNS + 1, TAKEN = ROWS * TAKEN_PITCH;
constexpr int ACROSS_PITCH = SSIM_WIDTH + 1, ACROSS = ROWS * ACROSS_PITCH;
/// Pixels next to one another that a thread blurs across, and down; what is read for several is
/// read once.
constexpr int RUN = 4, DROP = 2;
constexpr int RUNS = ROWS * (SSIM_WIDTH / RUN);
static_assert(RUNS <= SSIM_THREADS, "every run has its own thread");
static_assert(SSIM_WIDTH == WARP && SSIM_HEIGHT == DROP * SSIM_THREADS / WARP,
              "every thread of a warp has its own column, every warp its own rows");
/// Maps that are blurred: u, v, u^2 and v^2; the first two are taken from the images.
constexpr int MAPS = 4, IMAGE_MAPS = 2;
static_assert(MAPS * ACROSS > IMAGE_MAPS * TAKEN, "what is put there fits");
static_assert(TAKEN > ACROSS, "what is put there fits");

/// Weight of a tap of the Gaussian window of 11 taps, sigma 1.5 (gsfw.core.maths.ssim).
template <class T>
__device__ __forceinline__ T window_weight(int tap) {
  constexpr double half[] = {0.00102838008447911, 0.007598758135239185, 0.03600077212843083,
                             0.10936068950970002, 0.2130055377112537,   0.26601172486179436};
  return T(half[tap <= REACH ? tap : TAPS - 1 - tap]);
}

/// Place of a block: the image, and the first pixel of the tile.
struct Tile {
  int64 image;
  int left, top;
};

__device__ __forceinline__ Tile tile_of_block(const Comparison& of) {
  const int columns = (of.width + SSIM_WIDTH - 1) / SSIM_WIDTH;
  const int rows = (of.height + SSIM_HEIGHT - 1) / SSIM_HEIGHT;
  const int row = int(blockIdx.x) / columns;
  return {row / rows, int(blockIdx.x) % columns * SSIM_WIDTH, row % rows * SSIM_HEIGHT};
}

/// Index of a pixel within its image, counted from the tile's first; -1 outside the image.
__device__ __forceinline__ int64 pixel_at(const Comparison& of, const Tile& tile, int row,
                                          int column) {
  const int y = tile.top + row, x = tile.left + column;
  const bool inside = x >= 0 && y >= 0 && x < of.width && y < of.height;
  return inside ? int64(y) * of.width + x : -1;
}

__device__ __forceinline__ int64 image_size(const Comparison& of) {
  return int64(of.height) * of.width;
}

/// Whether a pixel of the tile's image counts.
__device__ __forceinline__ bool counts(const Comparison& of, const Tile& tile, int64 pixel) {
  return of.valid == nullptr || of.valid[tile.image * image_size(of) + pixel] != 0;
}

/// Take u and v of one channel, with the border. Pixels that do not count take the target's value.
/// Returns this thread's part of the sum of |x - y| over the tile; it is made of the images
/// themselves so that, as in plain torch, a NaN shows even where it does not count.
template <class T>
__device__ __forceinline__ T take_images(const Comparison& of, const Tile& tile, int channel,
                                           T* taken) {
  const int64 first = tile.image * image_size(of) * of.channels + channel;
  const T* rendered = static_cast<const T*>(of.rendered) + first;
  const T* target = static_cast<const T*>(of.target) + first;
  T total = T(0.0);
  for (int i = int(threadIdx.x); i < ROWS * COLUMNS; i += SSIM_THREADS) {
    const int row = i / COLUMNS, column = i % COLUMNS;
    const int64 pixel = pixel_at(of, tile, row - REACH, column - REACH);
    T u = T(0.0), v = T(0.0);
    if (pixel >= 0) {
      const T x = rendered[pixel * of.channels], y = target[pixel * of.channels];
      const bool counted = counts(of, tile, pixel);
      const bool own = row >= REACH && row < REACH + SSIM_HEIGHT && column >= REACH &&
                       column < REACH + SSIM_WIDTH;
      if (own) total = fma(absolute(x - y), T(counted ? 1.0 : 0.0), total);
      u = (counted ? x : y) + y;
      v = counted ? x - y : T(0.0);
    }
    taken[row * TAKEN_PITCH + column] = u;
    taken[TAKEN + row * TAKEN_PITCH + column] = v;
  }
  return total;
}

/// Take the flows of one channel, with the border.
template <class T>
__device__ __forceinline__ void take_flows(const SsimBackwardJob& job, const Tile& tile,
                                           int channel, T* taken) {
  const Comparison& of = job.images;
  const int64 size = image_size(of);
  const T* flows = static_cast<const T*>(job.flows) +
                   (tile.image * of.channels + channel) * SSIM_FLOWS * size;
  for (int i = int(threadIdx.x); i < ROWS * COLUMNS; i += SSIM_THREADS) {
    const int row = i / COLUMNS, column = i % COLUMNS;
    const int64 pixel = pixel_at(of, tile, row - REACH, column - REACH);
#pragma unroll
    for (int flow = 0; flow < SSIM_FLOWS; ++flow) {
      taken[flow * TAKEN + row * TAKEN_PITCH + column] =
          pixel >= 0 ? flows[flow * size + pixel] : T(0.0);
    }
  }
}

/// COUNT neighbours, blurred, from the numbers that their windows cover.
template <class T, int COUNT>
__device__ __forceinline__ void blur(const T (&in)[COUNT + TAPS - 1], T (&out)[COUNT]) {
#pragma unroll
  for (int i = 0; i < COUNT; ++i) {
    out[i] = window_weight<T>(0) * in[i];
#pragma unroll
    for (int tap = 1; tap < TAPS; ++tap) {
      out[i] = fma(window_weight<T>(tap), in[i + tap], out[i]);
    }
  }
}

/// The run of a row that a thread blurs across. A warp's runs lie below one another.
__device__ __forceinline__ int run_row() { return int(threadIdx.x) % ROWS; }
__device__ __forceinline__ int run_column() { return int(threadIdx.x) / ROWS * RUN; }
__device__ __forceinline__ bool has_run() { return int(threadIdx.x) < RUNS; }

/// Read the part of a map that the windows of this thread's run cover.
template <class T>
__device__ __forceinline__ void read_run(const T* map, T (&run)[RUN + TAPS - 1]) {
#pragma unroll
  for (int i = 0; i < RUN + TAPS - 1; ++i) {
    run[i] = map[run_row() * TAKEN_PITCH + run_column() + i];
  }
}

/// Put what was blurred across in place of what was taken; reached by all threads of the block.
template <class T, int COUNT>
__device__ __forceinline__ void put_across(const T (&across)[COUNT][RUN], T* maps) {
  __syncthreads();
  if (has_run()) {
#pragma unroll
    for (int map = 0; map < COUNT; ++map) {
#pragma unroll
      for (int i = 0; i < RUN; ++i) {
        maps[map * ACROSS + run_row() * ACROSS_PITCH + run_column() + i] = across[map][i];
      }
    }
  }
  __syncthreads();
}

/// The first row of the tile that this thread blurs down.
__device__ __forceinline__ int drop_row() { return warp_index() * DROP; }

/// This thread's pixels of a map that was blurred across.
template <class T>
__device__ __forceinline__ void blur_down(const T* map, T (&out)[DROP]) {
  T column[DROP + TAPS - 1];
#pragma unroll
  for (int i = 0; i < DROP + TAPS - 1; ++i) {
    column[i] = map[(drop_row() + i) * ACROSS_PITCH + lane_index()];
  }
  blur<T, DROP>(column, out);
}

/// 1 - SSIM, and what flows back (``SsimJob``).
template <class T>
struct Similarity {
  T lack;
  T flows[SSIM_FLOWS];
};

template <class T>
__device__ __forceinline__ Similarity<T> similarity_of(T mean_u, T mean_v, T blurred_uu,
                                                       T blurred_vv) {
  const T c1 = T(2.0 * C1), c2 = T(2.0 * C2);
  const T a = mean_u * mean_u, b = mean_v * mean_v;
  const T u = blurred_uu - a, v = blurred_vv - b;
  const T p = a + b + c1, q = u + v + c2;
  const T alike_p = a - b + c1, alike_q = u - v + c2;
  const T one_over = T(1.0) / (p * q);
  const T over_p = one_over * q, over_q = one_over * p;
  // With luminance = alike_p / p and structure = alike_q / q, 1 - luminance is 2 b / p and
  // 1 + luminance is 2 (a + c1) / p; likewise with structure.
  const T luminance = alike_p * over_p, structure = alike_q * over_q;
  const T lack = T(2.0) * fma(b, q, alike_p * v) * one_over;
  const T for_u = luminance * over_q * over_q, for_a = structure * over_p * over_p;
  const T by_u = for_u * v, by_v = -(for_u * (u + c2));
  const T by_a = for_a * b, by_b = -(for_a * (a + c1));
  return {lack, {fma(mean_u, by_a - by_u, mean_v * (by_b - by_v)), by_u, by_v}};
}

/// u, v, u^2 and v^2, blurred across.
template <class T>
__device__ __forceinline__ void blur_images(const T* taken, T (&across)[MAPS][RUN]) {
#pragma unroll
  for (int map = 0; map < IMAGE_MAPS; ++map) {
    T run[RUN + TAPS - 1];
    read_run(taken + map * TAKEN, run);
    blur<T, RUN>(run, across[map]);
#pragma unroll
    for (int i = 0; i < RUN + TAPS - 1; ++i) run[i] *= run[i];
    blur<T, RUN>(run, across[IMAGE_MAPS + map]);
  }
}

/// Similarity of this thread's pixels from maps that were blurred across; the flows go to the job.
/// Returns the sum of 1 - SSIM over those that count.
template <class T>
__device__ __forceinline__ T compare(const SsimJob& job, const Tile& tile, int channel,
                                     const T* maps, const T (&weights)[DROP]) {
  T blurred[MAPS][DROP];
#pragma unroll
  for (int map = 0; map < MAPS; ++map) blur_down(maps + map * ACROSS, blurred[map]);
  const Comparison& of = job.images;
  const int64 size = image_size(of);
  T* flows = static_cast<T*>(job.flows);
  if (flows != nullptr) flows += (tile.image * of.channels + channel) * SSIM_FLOWS * size;
  T total = T(0.0);
#pragma unroll
  for (int i = 0; i < DROP; ++i) {
    const Similarity<T> is =
        similarity_of(blurred[0][i], blurred[1][i], blurred[2][i], blurred[3][i]);
    total = fma(is.lack, weights[i], total);
    const int64 pixel = pixel_at(of, tile, drop_row() + i, lane_index());
    if (flows == nullptr || pixel < 0) continue;
#pragma unroll
    for (int flow = 0; flow < SSIM_FLOWS; ++flow) {
      flows[flow * size + pixel] = is.flows[flow] * weights[i];
    }
  }
  return total;
}

/// Blocks on a multiprocessor: without a number, NVRTC 13.0 takes registers for fewer on sm_100.
template <class T>
constexpr int SSIM_BLOCKS = sizeof(T) > 4 ? 1 : 4;
template <class T>
constexpr int SSIM_BACKWARD_BLOCKS = sizeof(T) > 4 ? 1 : 5;

/// See ``SsimJob``. One block of SSIM_THREADS for every tile of every image.
template <class T>
__global__ void __launch_bounds__(SSIM_THREADS, (SSIM_BLOCKS<T>)) ssim(SsimJob job) {
  __shared__ T maps[MAPS * ACROSS];
  const Comparison& of = job.images;
  const Tile tile = tile_of_block(of);
  T weights[DROP];
  T sums[SSIM_SUMS] = {};
#pragma unroll
  for (int i = 0; i < DROP; ++i) {
    const int64 pixel = pixel_at(of, tile, drop_row() + i, lane_index());
    weights[i] = T(pixel >= 0 && counts(of, tile, pixel) ? 1.0 : 0.0);
    sums[2] += weights[i];
  }
  for (int channel = 0; channel < of.channels; ++channel) {
    sums[0] += take_images(of, tile, channel, maps);
    __syncthreads();
    T across[MAPS][RUN] = {};
    if (has_run()) blur_images(maps, across);
    put_across(across, maps);
    sums[1] += compare(job, tile, channel, maps, weights);
    __syncthreads();
  }
  write_block_sums<SSIM_THREADS>(sums, job.sums + blockIdx.x, gridDim.x);
}

/// See ``LossesJob``. One block of SSIM_THREADS.
template <class T>
__global__ void __launch_bounds__(SSIM_THREADS) add_losses(LossesJob job) {
  __shared__ double totals[SSIM_SUMS];
  double sums[SSIM_SUMS] = {};
  for (int64 block = threadIdx.x; block < job.blocks; block += SSIM_THREADS) {
#pragma unroll
    for (int i = 0; i < SSIM_SUMS; ++i) sums[i] += job.sums[i * job.blocks + block];
  }
  write_block_sums<SSIM_THREADS>(sums, totals, 1);
  __syncthreads();
  if (threadIdx.x != 0) return;
  const double numbers = totals[2] * double(job.channels);
  const double share = 1.0 / (numbers > 0.0 ? numbers : 1.0);
  *static_cast<T*>(job.l1) = T(totals[0] * share);
  // Where no pixel counts, the similarity counts as 0.
  *static_cast<T*>(job.dissimilarity) = T(numbers > 0.0 ? totals[1] * share : 1.0);
  *static_cast<T*>(job.share) = T(share);
}

/// The gradient of this thread's pixels from flows that were blurred across.
template <class T>
__device__ __forceinline__ void return_flows(const SsimBackwardJob& job, const Tile& tile,
                                             int channel, const T* maps, T l1, T dissimilarity) {
  T blurred[SSIM_FLOWS][DROP];
#pragma unroll
  for (int flow = 0; flow < SSIM_FLOWS; ++flow) blur_down(maps + flow * ACROSS, blurred[flow]);
  const Comparison& of = job.images;
  const int64 first = tile.image * image_size(of) * of.channels + channel;
#pragma unroll
  for (int i = 0; i < DROP; ++i) {
    const int64 pixel = pixel_at(of, tile, drop_row() + i, lane_index());
    if (pixel < 0) continue;
    const int64 at = first + pixel * of.channels;
    const T x = static_cast<const T*>(of.rendered)[at], y = static_cast<const T*>(of.target)[at];
    const T u = x + y, v = x - y;
    const T similarity = fma(u, blurred[1][i], fma(v, blurred[2][i], blurred[0][i]));
    const T sign = T(v > T(0.0) ? 1.0 : 0.0) - T(v < T(0.0) ? 1.0 : 0.0);
    // Flows are a quarter of the derivatives of SSIM, of which the loss has less.
    const T gradient = fma(l1, sign, T(-4.0) * dissimilarity * similarity);
    static_cast<T*>(job.gradient)[at] = counts(of, tile, pixel) ? gradient : T(0.0);
  }
}

/// See ``SsimBackwardJob``. One block of SSIM_THREADS for every tile of every image.
template <class T>
__global__ void __launch_bounds__(SSIM_THREADS, (SSIM_BACKWARD_BLOCKS<T>))
    ssim_backward(SsimBackwardJob job) {
  __shared__ T maps[SSIM_FLOWS * TAKEN];
  const Tile tile = tile_of_block(job.images);
  const T share = *static_cast<const T*>(job.share);
  const T l1 = *static_cast<const T*>(job.l1_gradient) * share;
  const T dissimilarity = *static_cast<const T*>(job.dissimilarity_gradient) * share;
  for (int channel = 0; channel < job.images.channels; ++channel) {
    take_flows(job, tile, channel, maps);
    __syncthreads();
    T across[SSIM_FLOWS][RUN] = {};
    if (has_run()) {
#pragma unroll
      for (int flow = 0; flow < SSIM_FLOWS; ++flow) {
        T run[RUN + TAPS - 1];
        read_run(maps + flow * TAKEN, run);
        blur<T, RUN>(run, across[flow]);
      }
    }
    put_across(across, maps);
    return_flows(job, tile, channel, maps, l1, dissimilarity);
    __syncthreads();
  }
}

}  // namespace cuda
}  // namespace gsfw
