// View: a job's camera and conventions as the shared mathematics wants them.
#pragma once

#include "stages.h"

#include "camera.h"
#include "settings.h"

namespace gsfw {
namespace cuda {

/// The camera of a view and a grid; its matrices are read from device memory.
template <class T>
GSFW_FUNCTION Camera<T> camera_of(const View& view, const Grid& grid) {
  const T* m = static_cast<const T*>(view.world_to_camera);
  const T* k = static_cast<const T*>(view.intrinsics);
  Camera<T> camera;
  camera.model = static_cast<CameraModel>(view.model);
  camera.rotation = {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}};
  camera.translation = {m[3], m[7], m[11]};
  camera.focal = {k[0], k[4]};
  camera.principal = {k[2], k[5]};
  camera.size = {T(grid.width), T(grid.height)};
  set_slope_limits(camera, T(view.jacobian_margin));
  return camera;
}

/// The same in shared memory, for all threads of a block, which must reach this together: the six
/// divisions of the slope limits are done by one of them, and no thread keeps 27 numbers in
/// registers of its own.
template <class T>
__device__ __forceinline__ const Camera<T>& camera_of_block(const View& view, const Grid& grid) {
  __shared__ Camera<T> camera;
  if (threadIdx.x == 0) camera = camera_of<T>(view, grid);
  __syncthreads();
  return camera;
}

/// The conventions of a view.
template <class T>
GSFW_FUNCTION Settings<T> settings_of(const View& view) {
  return {T(view.dilation),
          T(view.compensation_min),
          T(view.alpha_min),
          T(view.near),
          T(view.far),
          T(view.length_max),
          T(view.quaternion_min_norm),
          view.antialias != 0,
          view.alpha_min > 0.0};
}

}  // namespace cuda
}  // namespace gsfw
