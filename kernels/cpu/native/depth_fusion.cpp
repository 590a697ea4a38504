// Fusion of depths: points that enough cameras agree on (Galliani et al. 2015, "Gipuma", section
// 4.4), once each.
//
// A place is represented by the camera that shows it most closely, so that it has as many points as
// that camera has pixels. No camera waits for another one's choice.
#include <cmath>

#include "pinhole.h"
#include "pool.h"
#include "stereo.h"

namespace gsfw {
namespace {

struct Pixel {
  int64_t x, y;
};

/// A pixel of one camera in another one.
struct Sighting {
  bool inside;
  Pixel pixel;
  /// Of the place there.
  double depth;
};

Sighting sighting(const Warp& warp, const StereoView& to, double x, double y, double depth) {
  double h[3];
  for (int k = 0; k < 3; ++k) {
    const double* const row = warp.turn + 3 * k;
    h[k] = (row[0] * x + row[1] * y + row[2]) * depth + warp.shift[k];
  }
  if (!(h[2] > 0)) return {false, {0, 0}, 0};
  const double u = h[0] / h[2], v = h[1] / h[2];
  const bool inside = u >= 0 && v >= 0 && u < double(to.width) && v < double(to.height);
  return {inside, inside ? Pixel{int64_t(u), int64_t(v)} : Pixel{0, 0}, h[2]};
}

/// The place of a pixel at its centre.
void unproject(const StereoView& view, Pixel pixel, double depth, double* to) {
  double inverse[9], local[3];
  inverse_intrinsics(view.intrinsics, inverse);
  const double x = double(pixel.x) + 0.5, y = double(pixel.y) + 0.5;
  for (int i = 0; i < 3; ++i) {
    const double ray = inverse[3 * i] * x + inverse[3 * i + 1] * y + inverse[3 * i + 2];
    local[i] = ray * depth - view.world_to_camera[4 * i + 3];
  }
  for (int j = 0; j < 3; ++j) {
    to[j] = 0;
    for (int i = 0; i < 3; ++i) to[j] += view.world_to_camera[4 * i + j] * local[i];
  }
}

/// Length of a pixel at a depth of 1.
double pixel_size(const StereoView& view) {
  return 1.0 / std::sqrt(std::abs(view.intrinsics[0] * view.intrinsics[4]));
}

struct Fusion {
  const std::vector<StereoView>& views;
  const std::vector<FusionView>& found;
  const FusionRule& rule;

  void fuse(int64_t index, const FusedView& to) const {
    const StereoView& view = views[index];
    std::vector<Warp> there, back;
    for (const int64_t other : found[index].neighbors) {
      there.push_back(warp_between(view, views[other]));
      back.push_back(warp_between(views[other], view));
    }
    for (int64_t y = 0; y < view.height; ++y) {
      for (int64_t x = 0; x < view.width; ++x) {
        const int64_t at = y * view.width + x;
        const bool is_there = found[index].depths[at] > 0;
        to.kinds[at] = is_there ? fuse_pixel(index, {x, y}, there, back, to) : UNCONFIRMED;
      }
    }
  }

  PixelKind fuse_pixel(int64_t index, Pixel pixel, const std::vector<Warp>& there,
                       const std::vector<Warp>& back, const FusedView& to) const {
    const StereoView& view = views[index];
    const int64_t at = pixel.y * view.width + pixel.x;
    const double depth = found[index].depths[at], own_size = depth * pixel_size(view);
    const double x = double(pixel.x) + 0.5, y = double(pixel.y) + 0.5;
    int64_t agreeing = 0, contradicting = 0;
    bool is_closest = true;
    double total[3], place[3];
    unproject(view, pixel, depth, total);
    const std::vector<int64_t>& neighbors = found[index].neighbors;
    for (size_t n = 0; n < neighbors.size(); ++n) {
      const int64_t other = neighbors[n];
      const Sighting seen = sighting(there[n], views[other], x, y, depth);
      if (!seen.inside) continue;
      const int64_t place_at = seen.pixel.y * views[other].width + seen.pixel.x;
      contradicting += found[other].empty[place_at];
      const double depth_there = found[other].depths[place_at];
      if (!(depth_there > 0) || !agree(seen, depth_there, back[n], view, x, y)) continue;
      ++agreeing;
      unproject(views[other], seen.pixel, depth_there, place);
      for (int k = 0; k < 3; ++k) total[k] += place[k];
      const double size = depth_there * pixel_size(views[other]);
      is_closest = is_closest && (own_size < size || (own_size == size && index < other));
    }
    for (int k = 0; k < 3; ++k) to.points[3 * at + k] = float(total[k] / double(agreeing + 1));
    const bool is_confirmed =
        agreeing >= rule.confirmations && contradicting <= rule.contradictions;
    return !is_confirmed ? UNCONFIRMED : is_closest ? REPRESENTS : CONFIRMED;
  }

  bool agree(const Sighting& seen, double depth_there, const Warp& back, const StereoView& view,
             double x, double y) const {
    if (std::abs(depth_there - seen.depth) > rule.depth_tolerance * seen.depth) return false;
    double h[3];
    const double u = double(seen.pixel.x) + 0.5, v = double(seen.pixel.y) + 0.5;
    for (int k = 0; k < 3; ++k) {
      const double* const row = back.turn + 3 * k;
      h[k] = (row[0] * u + row[1] * v + row[2]) * depth_there + back.shift[k];
    }
    const double dx = h[0] / h[2] - x, dy = h[1] / h[2] - y;
    return h[2] > 0 && dx * dx + dy * dy < rule.pixel_tolerance * rule.pixel_tolerance;
  }
};

}  // namespace

void fuse_views(const std::vector<StereoView>& views, const std::vector<FusionView>& found,
                const FusionRule& rule, const std::vector<FusedView>& fused, int threads) {
  const Fusion fusion = {views, found, rule};
  parallel(int64_t(views.size()), threads, [&](int64_t i, int) { fusion.fuse(i, fused[i]); });
}

}  // namespace gsfw
