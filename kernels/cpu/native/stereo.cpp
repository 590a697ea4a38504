#include "stereo.h"

#include <algorithm>
#include <vector>

#include "instruction_sets.h"
#include "memory.h"
#include "pinhole.h"
#include "pool.h"
#include "stereo_stages.h"

namespace gsfw {

#define GSFW_DECLARE(SET)                    \
  namespace SET {                            \
  extern const StereoKernels stereo_kernels; \
  }
GSFW_FOR_EACH_SET(GSFW_DECLARE)
#undef GSFW_DECLARE

namespace {

const StereoKernels& kernels() { return GSFW_CHOOSE(stereo_kernels); }

/// Working memory of one task.
struct SweepMemory {
  Buffer<uint8_t> costs, sums;
  Buffer<float> rows, planes;
};

std::vector<uint32_t> quads_of(const StereoView& view) {
  const int64_t height = view.height, width = view.width;
  std::vector<uint8_t> grey(static_cast<size_t>(height * width));
  for (size_t i = 0; i < grey.size(); ++i) {
    grey[i] = uint8_t(std::clamp(view.image[i], 0.0f, 1.0f) * 255.0f + 0.5f);
  }
  std::vector<uint32_t> quads(grey.size());
  for (int64_t y = 0; y < height; ++y) {
    const uint8_t* const here = grey.data() + y * width;
    const uint8_t* const below = y + 1 < height ? here + width : here;
    for (int64_t x = 0; x < width; ++x) {
      const int64_t right = x + 1 < width ? x + 1 : x;
      quads[y * width + x] = here[x] | uint32_t(here[right]) << 8 | uint32_t(below[x]) << 16 |
                             uint32_t(below[right]) << 24;
    }
  }
  return quads;
}

SweepNeighbor neighbor_of(const StereoView& from, const StereoView& to,
                          const std::vector<uint32_t>& quads) {
  const Warp warp = warp_between(from, to);
  SweepNeighbor neighbor;
  neighbor.image = {quads.data(), to.height, to.width};
  for (int k = 0; k < 9; ++k) neighbor.turn[k] = float(warp.turn[k]);
  for (int k = 0; k < 3; ++k) neighbor.shift[k] = float(warp.shift[k]);
  return neighbor;
}

void sweep_view(const std::vector<StereoView>& views,
                const std::vector<std::vector<uint32_t>>& quads, const SweepPlan& plan,
                const StereoDepths& to) {
  const StereoView& view = views[plan.view];
  std::vector<SweepNeighbor> neighbors;
  for (const int64_t other : plan.neighbors) {
    neighbors.push_back(neighbor_of(view, views[other], quads[other]));
  }
  const SweepJob job = {view.image, view.height, view.width, neighbors.data(),
                        int64_t(neighbors.size()), float(1.0 / plan.near), float(1.0 / plan.far),
                        plan.planes};
  const int64_t pixels = view.height * view.width;
  const auto memory = Recycler<SweepMemory>::instance().take();
  uint8_t* const costs = memory->costs.reserve(size_t(pixels * plan.planes));
  kernels().sweep(job, costs, memory->rows.reserve(size_t(kernels().sweep_scratch(job))));
  const MatchingJob matching = {costs, view.image, view.height, view.width, plan.planes};
  uint8_t* const sums = memory->sums.reserve(size_t(kernels().matching_scratch(matching)));
  kernels().matching(matching, {to.depths, to.scores, to.contrasts}, sums);
  const double step = (1.0 / plan.far - 1.0 / plan.near) / double(plan.planes - 1);
  for (int64_t i = 0; i < pixels; ++i) {
    to.depths[i] = float(1.0 / (1.0 / plan.near + step * double(to.depths[i])));
  }
}

}  // namespace

void sweep_views(const std::vector<StereoView>& views, const std::vector<SweepPlan>& plans,
                 const std::vector<StereoDepths>& results, int threads) {
  std::vector<std::vector<uint32_t>> quads(views.size());
  parallel(int64_t(views.size()), threads,
           [&](int64_t i, int) { quads[i] = quads_of(views[i]); });
  parallel(int64_t(plans.size()), threads,
           [&](int64_t i, int) { sweep_view(views, quads, plans[i], results[i]); });
  Recycler<SweepMemory>::instance().clear();
}

}  // namespace gsfw
