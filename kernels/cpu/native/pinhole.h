// Two pinhole cameras: where the pixels of one lie in the other.
#pragma once

#include "stereo.h"

namespace gsfw {

/// Pixel p of one camera at depth z lies at ``turn`` p + ``shift`` / z in the other, in homogeneous
/// pixels, of which the last is the depth there over z.
struct Warp {
  double turn[9], shift[3];
};

inline void product(const double* a, const double* b, double* to) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      to[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    }
  }
}

/// The inverse of [[fx, s, cx], [0, fy, cy], [0, 0, 1]].
inline void inverse_intrinsics(const double* k, double* to) {
  const double x = 1.0 / k[0], y = 1.0 / k[4];
  const double inverse[9] = {x, -k[1] * x * y, (k[1] * k[5] * y - k[2]) * x,
                             0, y, -k[5] * y, 0, 0, 1};
  for (int i = 0; i < 9; ++i) to[i] = inverse[i];
}

/// The rotation of a rigid [3, 4].
inline void rotation_of(const double* pose, double* to) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) to[3 * i + j] = pose[4 * i + j];
  }
}

inline Warp warp_between(const StereoView& from, const StereoView& to) {
  double rotation[9], other[9], turned[9], between[9], inverse[9], rays[9];
  rotation_of(from.world_to_camera, rotation);
  rotation_of(to.world_to_camera, other);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) turned[3 * i + j] = rotation[3 * j + i];
  }
  product(other, turned, between);
  inverse_intrinsics(from.intrinsics, inverse);
  product(between, inverse, rays);
  Warp warp;
  product(to.intrinsics, rays, warp.turn);
  double moved[3];
  for (int i = 0; i < 3; ++i) {
    moved[i] = to.world_to_camera[4 * i + 3];
    for (int j = 0; j < 3; ++j) moved[i] -= between[3 * i + j] * from.world_to_camera[4 * j + 3];
  }
  for (int i = 0; i < 3; ++i) {
    warp.shift[i] = 0;
    for (int j = 0; j < 3; ++j) warp.shift[i] += to.intrinsics[3 * i + j] * moved[j];
  }
  return warp;
}

}  // namespace gsfw
