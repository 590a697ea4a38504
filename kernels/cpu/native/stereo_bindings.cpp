// Stereo, as Python sees it: the caller's arrays, neither copied nor converted.
#include "bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "stereo.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace gsfw {
namespace {

using Image = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Plane = nb::ndarray<float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Matrices = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Numbers = std::vector<int64_t>;

/// Indices of pixels are whole numbers that float32 holds.
constexpr int64_t MOST_PIXELS = 1 << 24;
/// Planes have a place of 8 bits in a sum of 16 over eight paths.
constexpr int64_t MOST_PLANES = 256;

void require(bool fits, const char* complaint) {
  if (!fits) throw std::invalid_argument(complaint);
}

template <typename A>
bool is_of(const A& array, const StereoView& view) {
  return int64_t(array.shape(0)) == view.height && int64_t(array.shape(1)) == view.width;
}

std::vector<StereoView> views_of(const std::vector<Image>& images, const Matrices& poses,
                                 const Matrices& intrinsics) {
  const size_t count = images.size();
  require(poses.shape(0) == count && poses.shape(1) == 4 && poses.shape(2) == 4,
          "the poses are not one 4x4 matrix per image");
  require(intrinsics.shape(0) == count && intrinsics.shape(1) == 3 && intrinsics.shape(2) == 3,
          "the intrinsics are not one 3x3 matrix per image");
  std::vector<StereoView> views;
  for (size_t i = 0; i < count; ++i) {
    const int64_t height = int64_t(images[i].shape(0)), width = int64_t(images[i].shape(1));
    require(height > 0 && width > 0 && height * width < MOST_PIXELS, "an image has no usable size");
    StereoView view = {images[i].data(), height, width, {}, {}};
    std::copy_n(poses.data() + 16 * i, 12, view.world_to_camera);
    std::copy_n(intrinsics.data() + 9 * i, 9, view.intrinsics);
    views.push_back(view);
  }
  return views;
}

void check_neighbors(const Numbers& neighbors, size_t views) {
  for (const int64_t other : neighbors) {
    require(other >= 0 && other < int64_t(views), "there is no such neighbour");
  }
}

void sweep(const std::vector<Image>& images, const Matrices& poses, const Matrices& intrinsics,
           const Numbers& chosen, const std::vector<Numbers>& neighbors,
           const std::vector<double>& near, const std::vector<double>& far, const Numbers& planes,
           const std::vector<Plane>& depths, const std::vector<Plane>& scores,
           const std::vector<Plane>& contrasts, int threads) {
  const std::vector<StereoView> views = views_of(images, poses, intrinsics);
  const size_t count = chosen.size();
  require(neighbors.size() == count && near.size() == count && far.size() == count &&
              planes.size() == count && depths.size() == count && scores.size() == count &&
              contrasts.size() == count,
          "the plans are not of one length");
  std::vector<SweepPlan> plans;
  std::vector<StereoDepths> results;
  check_neighbors(chosen, views.size());
  for (size_t i = 0; i < count; ++i) {
    const StereoView& view = views[chosen[i]];
    check_neighbors(neighbors[i], views.size());
    require(!neighbors[i].empty(), "a view has no neighbours");
    require(near[i] > 0 && far[i] > near[i], "depths do not increase");
    require(planes[i] >= 2 && planes[i] <= MOST_PLANES, "the number of planes is out of range");
    require(is_of(depths[i], view) && is_of(scores[i], view) && is_of(contrasts[i], view),
            "a result does not fit its image");
    plans.push_back({chosen[i], neighbors[i], near[i], far[i], planes[i]});
    results.push_back({depths[i].data(), scores[i].data(), contrasts[i].data()});
  }
  nb::gil_scoped_release unlocked;
  sweep_views(views, plans, results, threads);
}

void fuse(const std::vector<Image>& depths, const Matrices& poses, const Matrices& intrinsics,
          const std::vector<Flags>& empty, const std::vector<Numbers>& neighbors,
          double depth_tolerance, double pixel_tolerance, int64_t confirmations,
          int64_t contradictions, const std::vector<Places>& points,
          const std::vector<Flags>& kinds, int threads) {
  const std::vector<StereoView> views = views_of(depths, poses, intrinsics);
  const size_t count = views.size();
  require(empty.size() == count && neighbors.size() == count && points.size() == count &&
              kinds.size() == count,
          "there is not one of each for every view");
  std::vector<FusionView> found;
  std::vector<FusedView> fused;
  for (size_t i = 0; i < count; ++i) {
    check_neighbors(neighbors[i], count);
    require(is_of(empty[i], views[i]) && is_of(kinds[i], views[i]) && is_of(points[i], views[i]) &&
                points[i].shape(2) == 3,
            "an array does not fit its view");
    found.push_back({depths[i].data(), empty[i].data(), neighbors[i]});
    fused.push_back({points[i].data(), kinds[i].data()});
  }
  const FusionRule rule = {depth_tolerance, pixel_tolerance, confirmations, contradictions};
  nb::gil_scoped_release unlocked;
  fuse_views(views, found, rule, fused, threads);
}

}  // namespace

void bind_stereo(nb::module_& module) {
  module.def("sweep_views", &sweep, "images"_a.noconvert(), "poses"_a.noconvert(),
             "intrinsics"_a.noconvert(), "chosen"_a, "neighbors"_a, "near"_a, "far"_a, "planes"_a,
             "depths"_a.noconvert(), "scores"_a.noconvert(), "contrasts"_a.noconvert(),
             "threads"_a, "Write depth, match and contrast of the pixels of the chosen views.");
  module.def("fuse_views", &fuse, "depths"_a.noconvert(), "poses"_a.noconvert(),
             "intrinsics"_a.noconvert(), "empty"_a.noconvert(), "neighbors"_a,
             "depth_tolerance"_a, "pixel_tolerance"_a, "confirmations"_a, "contradictions"_a,
             "points"_a.noconvert(), "kinds"_a.noconvert(), "threads"_a,
             "Write points that cameras agree on; pixels are 1 if confirmed, 2 if they represent one.");
}

}  // namespace gsfw
