// Project, backward: from the sums that blending left of each splat to its gradients.
//
// One thread per row of the model, as forward. Whatever a splat that is not visible would give is
// NaN at times, and never looked at: its gradients are zeros from the start.
#include "stages.h"

#include "coefficients.h"
#include "gradients.h"
#include "splat.h"
#include "view.h"

namespace gsfw {
namespace cuda {

/// Blocks that registers must leave room for on a multiprocessor: what is short here is memory, for
/// which more threads wait in parallel. With this many, no number is kept in local memory: a ragged
/// row's place in its array takes registers too.
template <class T, int DEGREE, bool RAGGED>
constexpr int PROJECT_BACKWARD_BLOCKS =
    sizeof(T) != sizeof(float) ? 4 : DEGREE < 4 && !RAGGED ? 10 : 8;

/// The gradient of SH coefficients, and by the mean through the direction they are seen from.
/// Reached by all lanes.
template <int DEGREE, bool RAGGED, class T>
__device__ __forceinline__ Vector3<T> sh_backward(const ProjectBackwardJob& job,
                                                  const WarpRows& rows, const SlotSums<T>& sums,
                                                  bool visible, const Vector3<T>& mean,
                                                  const Vector3<T>& center) {
  __shared__ Coefficients<T, DEGREE> staged[PROJECT_THREADS / WARP];
  Coefficients<T, DEGREE>& coefficients = staged[warp_index()];
  fetch<RAGGED>(job.forward.splats, rows, coefficients);
  T* own = coefficients.rows[lane_index()];
  T basis[num_coefficients(DEGREE)];
  const Vector3<T> direction = view_direction(mean, center);
  sh_basis(DEGREE, direction, basis);
  const Vector3<T> sum = sum_bands<DEGREE>(own, basis);
  // The coefficients are read again below: this keeps them from being held in registers until then.
  __syncwarp(FULL_WARP);
  Vector3<T> by_mean{};
  if (visible) {
    T by_color[3];
    sums.template add_up<3>(SUM_CHANNELS, by_color);
    const Vector3<T> by_sum{sh_color_vjp(sum.x, by_color[0]), sh_color_vjp(sum.y, by_color[1]),
                            sh_color_vjp(sum.z, by_color[2])};
    sum_bands_vjp<DEGREE>(by_sum, own, basis);
    if constexpr (DEGREE > 0) {
      by_mean = view_direction_vjp(mean, center, sh_basis_vjp(DEGREE, direction, basis));
    }
  }
  give<RAGGED>(coefficients, rows, job.accumulate != 0, job.forward.splats, job.gradients);
  return by_mean;
}

/// Gradients by colours that are channels, from channel 0, and by the extra ones after them.
template <class T, int DEGREE>
GSFW_FUNCTION void channels_backward(const ProjectBackwardJob& job, const GradientWriter& writer,
                                     const SlotSums<T>& sums) {
  const SplatArrays& splats = job.forward.splats;
  int field = SUM_CHANNELS;
  for (int c = 0; DEGREE < 0 && c < splats.color_channels; ++c) {
    const T gradient = sums[field + c];
    writer.write<1>(job.gradients.colors, splats.color_stride, c, &gradient);
  }
  field += splats.color_channels;
  for (int c = 0; job.gradients.extra && c < splats.extras; ++c) {
    const T gradient = sums[field + c];
    writer.write<1>(job.gradients.extra, splats.extras, c, &gradient);
  }
}

/// Gradient of a projected Gaussian from the sums of blending.
template <class T>
GSFW_FUNCTION ProjectionGradient<T> gradient_of(const ProjectBackwardJob& job,
                                                const Projection<T>& splat,
                                                const SlotSums<T>& sums) {
  T total[SUM_CHANNELS];
  sums.template add_up<SUM_CHANNELS>(0, total);
  const Moments<T> moments = unscale_from_binary(
      Moments<T>{total[SUM_G],
                 {total[SUM_U], total[SUM_V]},
                 {total[SUM_UU], total[SUM_UV], total[SUM_VV]}});
  const SplatArrays& splats = job.forward.splats;
  const int depth_channel = splats.color_channels + splats.extras;
  const Whitening<T> whitening = whiten(splat.covariance, splat.determinant);
  return {mean_vjp(whitening, moments.first),
          splats.depth_channels > 0 ? sums[SUM_CHANNELS + depth_channel] : T(0), moments.second,
          moments.n / maximum(splat.opacity, T(OPACITY_MIN))};
}

/// The norm of a gradient per half image, which is what it would be in coordinates of [-1, 1].
template <class T>
GSFW_FUNCTION T norm_per_half_image(const Grid& grid, const T& by_x, const T& by_y) {
  const T across = by_x * (T(0.5) * T(grid.width)), down = by_y * (T(0.5) * T(grid.height));
  return square_root(fma(across, across, down * down));
}

/// Write what strategies observe of a visible row.
template <class T>
GSFW_FUNCTION void write_statistics(const ProjectBackwardJob& job, int64 row,
                                    const Vector2<T>& by_mean, const SlotSums<T>& sums) {
  const Grid& grid = job.forward.grid;
  if (job.screen_gradient) {
    static_cast<T*>(job.screen_gradient)[row] = norm_per_half_image(grid, by_mean.x, by_mean.y);
  }
  if (job.absgrad) {
    const T unscale(1.0 / (binary_scale * binary_scale));
    T magnitudes[2];
    sums.template add_up<2>(SUM_CHANNELS + job.channels, magnitudes);
    static_cast<T*>(job.absgrad)[row] =
        norm_per_half_image(grid, unscale * magnitudes[0], unscale * magnitudes[1]);
  }
}

/// Write the sum of a block's pose gradients, always added in the same order. Reached by all
/// threads.
template <class T>
__device__ __forceinline__ void write_pose(const PoseGradient<T>& share,
                                           const Vector3<T>& by_center, void* pose) {
  __shared__ T sums[PROJECT_THREADS / WARP][POSE_FIELDS];
  const Vector3<T> rows[POSE_FIELDS / 3] = {share.rotation.x, share.rotation.y, share.rotation.z,
                                            share.translation, by_center};
#pragma unroll
  for (int k = 0; k < POSE_FIELDS / 3; ++k) {
    const Vector3<T> sum{warp_sum(rows[k].x), warp_sum(rows[k].y), warp_sum(rows[k].z)};
    if (lane_index() != 0) continue;
    T* to = sums[warp_index()] + 3 * k;
    to[0] = sum.x;
    to[1] = sum.y;
    to[2] = sum.z;
  }
  __syncthreads();
  const int field = int(threadIdx.x);
  if (field >= POSE_FIELDS) return;
  T total(0);
  for (int warp = 0; warp < PROJECT_THREADS / WARP; ++warp) total += sums[warp][field];
  static_cast<T*>(pose)[int64(blockIdx.x) * POSE_FIELDS + field] = total;
}

/// project_backward<T, Shape, DEGREE, RAGGED, POSE>: see ProjectBackwardJob; Shape, DEGREE and
/// RAGGED as forward, POSE to write ``pose``. Blocks of PROJECT_THREADS.
template <class T, class Shape, int DEGREE, bool RAGGED, bool POSE>
__global__ void __launch_bounds__(PROJECT_THREADS, (PROJECT_BACKWARD_BLOCKS<T, DEGREE, RAGGED>))
    project_backward(ProjectBackwardJob job) {
  const SplatArrays& splats = job.forward.splats;
  const int64 row = thread_index();
  const bool inside = row < splats.count, add = job.accumulate != 0;
  const bool visible = inside && job.forward.visible[row] != 0;
  const GradientWriter writer{row, add ? visible : inside, add};
  const SlotSums<T> sums = sums_of<T>(job, row, visible);
  const Camera<T> camera = camera_of<T>(job.forward.view, job.forward.grid);
  channels_backward<T, DEGREE>(job, writer, sums);

  Vector3<T> turned{};
  if constexpr (DEGREE >= 0) {
    const WarpRows rows = rows_of_warp(row, inside, visible);
    const Vector3<T> mean = load_vector<T>(splats.means, inside ? row : splats.count - 1);
    turned =
        sh_backward<DEGREE, RAGGED>(job, rows, sums, visible, mean, camera_center(camera));
  }
  GaussianGradient<T, Shape> gradient{};
  if (visible) {
    const Settings<T> settings = settings_of<T>(job.forward.view);
    const Splat<T, Shape> splat = load_splat<T, Shape>(splats, row);
    const ProjectionGradient<T> seen = gradient_of(
        job, project(splat.mean, splat.shape, splat.opacity, camera, settings), sums);
    write_statistics(job, row, seen.mean, sums);
    gradient = project_vjp(splat.mean, splat.shape, splat.opacity, camera, settings, seen);
  }
  writer.write(job.gradients.means, gradient.mean + turned);
  writer.write_shape(job.gradients, gradient.shape);
  writer.write<1>(job.gradients.opacities, 1, 0, &gradient.opacity);
  if constexpr (POSE) write_pose(gradient.pose, -turned, job.pose);
}

}  // namespace cuda
}  // namespace gsfw
