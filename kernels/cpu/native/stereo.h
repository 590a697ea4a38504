// Stereo: depths of all pixels of cameras from the images of their neighbours, and the points that
// several of them agree on.
//
// Results are the same to the bit for any number of threads: every camera is computed by itself.
#pragma once

#include <cstdint>
#include <vector>

namespace gsfw {

/// A pinhole camera and its image.
struct StereoView {
  /// [height, width], grey in [0, 1].
  const float* image;
  int64_t height, width;
  /// [3, 4] and [3, 3]; rigid, in scene units and pixels.
  double world_to_camera[12], intrinsics[9];
};

/// What is to be swept for one camera.
struct SweepPlan {
  int64_t view;
  std::vector<int64_t> neighbors;
  /// Depths of the first and the last plane, and their number, 2 or more.
  double near, far;
  int64_t planes;
};

/// Depths of one camera's pixels; [height, width] each.
struct StereoDepths {
  float* depths;
  float* scores;
  float* contrasts;
};

/// Depths of the cameras of ``plans``.
void sweep_views(const std::vector<StereoView>& views, const std::vector<SweepPlan>& plans,
                 const std::vector<StereoDepths>& results, int threads);

/// A camera's depths, and the cameras that may confirm them.
struct FusionView {
  /// [height, width]: 0 where there is none.
  const float* depths;
  /// [height, width]: 1 where the image shows background.
  const uint8_t* empty;
  std::vector<int64_t> neighbors;
};

struct FusionRule {
  /// Largest relative difference of two depths that agree, and of the pixel that leads back.
  double depth_tolerance, pixel_tolerance;
  /// Cameras that have to agree, and that may show background in place of a point.
  int64_t confirmations, contradictions;
};

/// Values of ``FusedView::kinds``.
enum PixelKind : uint8_t { UNCONFIRMED, CONFIRMED, REPRESENTS };

/// Of one camera's pixels [height, width]: the means of what cameras agree on, and whether enough
/// of them do. A pixel represents its place if this camera shows it most closely among them.
struct FusedView {
  float* points;
  uint8_t* kinds;
};

/// Fill ``fused``, one for each view.
void fuse_views(const std::vector<StereoView>& views, const std::vector<FusionView>& found,
                const FusionRule& rule, const std::vector<FusedView>& fused, int threads);

}  // namespace gsfw
