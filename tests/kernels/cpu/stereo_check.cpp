// Checks of stereo that need no Python, for sanitizers and emulators.
//
// A plane has to be found at its depth by every instruction set, and results must be the same bits
// for any number of threads. It prints what is not and exits with 1, or exits with 0.
#include "stereo.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "check.h"
#include "instruction_sets.h"

namespace gsfw {
namespace {

constexpr int64_t VIEWS = 4, WIDTH = 37;
constexpr int64_t HEIGHTS[VIEWS] = {29, 1, 18, 29};
constexpr double DEPTH = 4.0, FOCAL = 40.0, STEP = 0.3;

/// Grey of the plane at a place across.
float grey(double x, double y) {
  return float(0.5 + 0.25 * std::sin(0.9 * x + 0.3 * y) + 0.2 * std::sin(0.31 * x - 0.7 * y));
}

struct Scene {
  std::vector<std::vector<float>> images;
  std::vector<StereoView> views;

  Scene() {
    for (int64_t i = 0; i < VIEWS; ++i) {
      std::vector<float> image;
      for (int64_t y = 0; y < HEIGHTS[i]; ++y) {
        for (int64_t x = 0; x < WIDTH; ++x) {
          image.push_back(grey(double(x) + STEP * double(i) * FOCAL / DEPTH, double(y)));
        }
      }
      images.push_back(image);
    }
    for (int64_t i = 0; i < VIEWS; ++i) {
      views.push_back({images[i].data(), HEIGHTS[i], WIDTH,
                       {1, 0, 0, -STEP * double(i), 0, 1, 0, 0, 0, 0, 1, 0},
                       {FOCAL, 0, WIDTH / 2.0, 0, FOCAL, 14.5, 0, 0, 1}});
    }
  }
};

/// Depths, matches, contrasts and points of all views, one after another.
std::vector<float> stereo_of(const Scene& scene, int threads) {
  const std::vector<SweepPlan> plans = {{0, {2, 3}, 2.0, 10.0, 33},
                                        {1, {0}, 2.0, 10.0, 2},
                                        {2, {0, 1, 3}, 3.0, 6.0, 16},
                                        {3, {2, 0}, 2.0, 10.0, 256}};
  std::vector<std::vector<float>> planes(3 * VIEWS), points(VIEWS);
  std::vector<std::vector<uint8_t>> empty(VIEWS), kept(VIEWS);
  std::vector<StereoDepths> depths;
  std::vector<FusionView> found;
  std::vector<FusedView> fused;
  for (int64_t i = 0; i < VIEWS; ++i) {
    const size_t pixels = size_t(HEIGHTS[i] * WIDTH);
    for (int64_t k = 0; k < 3; ++k) planes[3 * i + k].resize(pixels);
    points[i].resize(3 * pixels);
    empty[i].resize(pixels);
    kept[i].resize(pixels);
    depths.push_back({planes[3 * i].data(), planes[3 * i + 1].data(), planes[3 * i + 2].data()});
    found.push_back({planes[3 * i].data(), empty[i].data(), plans[i].neighbors});
    fused.push_back({points[i].data(), kept[i].data()});
  }
  sweep_views(scene.views, plans, depths, threads);
  fuse_views(scene.views, found, {0.02, 1.5, 1, 0}, fused, threads);
  std::vector<float> all;
  for (const auto& numbers : planes) all.insert(all.end(), numbers.begin(), numbers.end());
  for (const auto& numbers : points) all.insert(all.end(), numbers.begin(), numbers.end());
  for (const auto& flags : kept) all.insert(all.end(), flags.begin(), flags.end());
  return all;
}

void check_everything() {
  const Scene scene;
  for (const std::string& set : instruction_sets()) {
    use_instruction_set(set);
    const std::vector<float> one = stereo_of(scene, 1);
    int64_t near = 0;
    for (int64_t i = 0; i < HEIGHTS[0] * WIDTH; ++i) {
      near += std::abs(one[size_t(i)] - DEPTH) < 0.05 * DEPTH;
    }
    if (near < HEIGHTS[0] * WIDTH / 2) fail(set + ": the plane is not at its depth");
    for (const int threads : {2, 5}) {
      const std::vector<float> other = stereo_of(scene, threads);
      if (std::memcmp(one.data(), other.data(), one.size() * sizeof(float)) == 0) continue;
      fail(set + ": differs on " + std::to_string(threads) + " threads");
    }
  }
}

}  // namespace
}  // namespace gsfw

int main() {
  gsfw::check_everything();
  if (gsfw::failures) std::printf("%d failures in all\n", gsfw::failures);
  return gsfw::failures ? 1 : 0;
}
