// Checks of rendering that need no Python, for sanitizers and emulators: small scenes of odd sizes,
// forward and backward, with every instruction set that the machine has.
//
// Results must be the same bits for any number of threads, and close to those of float64. It prints
// what is not and exits with 1, or exits with 0. With the argument "emulated" it leaves out the
// fork, which qemu's user mode does not survive once there are threads.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "check.h"
#include "bands.h"
#include "render_pass.h"
#include "instruction_sets.h"

namespace gsfw {
namespace {

/// What one scene looks like and what is asked for.
struct Case {
  const char* name;
  int count, width, height;
  /// -1: ``colors`` plain channels.
  int sh_degree = 2, colors = 3;
  /// Whether coefficients from the second on lie in an array of their own, and there ragged: of
  /// degrees 0 to ``sh_degree`` and one above it, in turn.
  bool split = false, ragged = false;
  int extras = 0, depth_channels = 0, model = 0;
  bool covariances = false, antialias = false, bounded = true;
  /// Everything that may be left out: contributions with weights of the pixels, gradient of alpha,
  /// pose, screen and absolute gradients.
  bool everything = false;
  /// Some splats that are no splats: not finite, of no size, of immense size, behind the camera.
  bool hostile = false;
};

constexpr Case CASES[] = {
    {.name = "empty", .count = 0, .width = 17, .height = 31, .everything = true},
    {.name = "one splat", .count = 1, .width = 17, .height = 31, .everything = true},
    {.name = "one pixel", .count = 40, .width = 1, .height = 1},
    {.name = "column", .count = 33, .width = 1, .height = 4096, .sh_degree = 0},
    {.name = "row", .count = 33, .width = 1030, .height = 1, .sh_degree = 1, .everything = true},
    {.name = "many", .count = 2100, .width = 33, .height = 18, .sh_degree = 3, .split = true},
    {.name = "high degree", .count = 50, .width = 31, .height = 17, .sh_degree = 4, .split = true},
    {.name = "ragged", .count = 150, .width = 31, .height = 17, .sh_degree = 2, .split = true,
     .ragged = true, .everything = true},
    {.name = "channels", .count = 300, .width = 17, .height = 31, .sh_degree = -1, .colors = 5,
     .extras = 17, .depth_channels = 2, .model = 1, .everything = true},
    {.name = "one channel", .count = 100, .width = 48, .height = 32, .sh_degree = -1, .colors = 1,
     .covariances = true, .antialias = true, .everything = true},
    {.name = "unbounded", .count = 20, .width = 40, .height = 23, .model = 2, .bounded = false},
    {.name = "hostile", .count = 500, .width = 50, .height = 37, .everything = true,
     .hostile = true},
};

/// Numbers that float holds, so that float64 renders the very same scene.
class Dice {
 public:
  explicit Dice(unsigned seed) : bits_(seed) {}

  template <typename T>
  std::vector<T> uniform(int64_t size, double low, double high) {
    std::vector<T> numbers(static_cast<size_t>(size));
    for (T& x : numbers) {
      x = T(float(low + (high - low) * double(bits_()) / double(std::mt19937::max())));
    }
    return numbers;
  }

 private:
  std::mt19937 bits_;
};

template <typename T>
struct Scene {
  Case is;
  int channels;
  std::vector<T> means, quats, scales, covariances, opacities, colors, rest, extra, background;
  std::vector<T> image_gradient, alpha_gradient, pixel_weights;
  std::vector<int64_t> offsets;
};

template <typename T>
void make_hostile(Scene<T>& scene) {
  const T wild[] = {T(NAN), T(INFINITY), -T(INFINITY), T(1e30), T(-1e30), T(0), T(1e-40)};
  std::mt19937 bits(5);
  std::vector<T>* const arrays[] = {&scene.means, &scene.quats, &scene.scales, &scene.opacities};
  for (std::vector<T>* array : arrays) {
    for (size_t i = 0; i < array->size(); i += 1 + bits() % 60) (*array)[i] = wild[bits() % 7];
  }
  for (size_t i = 2; i < scene.means.size(); i += 30) scene.means[i] = T(-4);
}

/// Symmetric, with two extents of some tenths and one of nothing.
template <typename T>
std::vector<T> make_covariances(Dice& dice, int64_t n) {
  const std::vector<T> a = dice.uniform<T>(n * 6, -0.2, 0.2);
  std::vector<T> covariances(static_cast<size_t>(n * 9));
  for (int64_t row = 0; row < n; ++row) {
    const T* axes = &a[size_t(row * 6)];
    for (int k = 0; k < 9; ++k) {
      const int i = k / 3, j = k % 3;
      covariances[size_t(row * 9 + k)] = axes[i] * axes[j] + axes[3 + i] * axes[3 + j];
    }
  }
  return covariances;
}

template <typename T>
Scene<T> make_scene(const Case& is) {
  Dice dice(11);
  const int64_t n = is.count, pixels = int64_t(is.width) * is.height;
  const bool sh = is.sh_degree >= 0;
  const int coefficients = sh ? 3 * (is.sh_degree + 1) * (is.sh_degree + 1) : is.colors;
  Scene<T> scene{};
  scene.is = is;
  scene.channels = (sh ? 3 : is.colors) + is.extras + is.depth_channels;
  scene.means = dice.uniform<T>(n * 3, -1.2, 1.2);
  scene.opacities = dice.uniform<T>(n, 0.05, 0.995);
  if (is.covariances) {
    scene.covariances = make_covariances<T>(dice, n);
  } else {
    scene.quats = dice.uniform<T>(n * 4, -1, 1);
    scene.scales = dice.uniform<T>(n * 3, 0.01, 0.2);
  }
  scene.colors = dice.uniform<T>(n * (is.split ? 3 : coefficients), -0.5, 0.8);
  scene.offsets.assign(1, 0);
  for (int64_t row = 0; row < n && is.ragged; ++row) {
    const int64_t degree = row % (is.sh_degree + 2);
    scene.offsets.push_back(scene.offsets.back() + degree * (degree + 2));
  }
  const int64_t rest = is.ragged ? 3 * scene.offsets.back() : n * (coefficients - 3);
  if (is.split) scene.rest = dice.uniform<T>(rest, -0.3, 0.3);
  if (is.extras) scene.extra = dice.uniform<T>(n * is.extras, -1, 1);
  scene.background = dice.uniform<T>(scene.channels, 0, 1);
  scene.image_gradient = dice.uniform<T>(pixels * scene.channels, -1, 1);
  if (is.everything) scene.alpha_gradient = dice.uniform<T>(pixels, -1, 1);
  if (is.everything) scene.pixel_weights = dice.uniform<T>(pixels, -0.2, 1);
  if (is.hostile) make_hostile(scene);
  return scene;
}

template <typename T>
const T* or_null(const std::vector<T>& array) {
  return array.empty() ? nullptr : array.data();
}

template <typename T>
RenderArguments<T> arguments_of(const Scene<T>& scene, int threads) {
  const Case& is = scene.is;
  RenderArguments<T> arguments{};
  const T focal = T(1.2) * T(is.width > is.height ? is.width : is.height);
  ViewParameters<T>& view = arguments.view;
  // Turned by 0.6, 0.8 about z, so that no axis of the camera is one of the scene's.
  view = {{T(0.6), T(-0.8), 0, T(0.1), T(0.8), T(0.6), 0, T(-0.1), 0, 0, 1, 4},
          is.model == 1 ? focal / 4 : focal, is.model == 1 ? focal / 4 : focal,
          T(is.width) / 2, T(is.height) / 2, is.width, is.height, is.model,
          T(0.3), T(0.3), T(0.005), is.bounded ? T(1.0 / 255.0) : T(0), T(0.01), T(1e10), T(1e9),
          T(1e-12), is.antialias};
  SplatArrays<T>& splats = arguments.splats;
  splats = {is.count, scene.means.data(), or_null(scene.quats), or_null(scene.scales),
            or_null(scene.covariances), scene.opacities.data(), scene.colors.data(),
            is.count ? int(scene.colors.size()) / is.count : 3, is.sh_degree,
            or_null(scene.rest),
            is.ragged ? 3 : is.split ? int(scene.rest.size()) / is.count : 0,
            is.ragged ? scene.offsets.data() : nullptr, or_null(scene.extra), is.extras,
            is.sh_degree >= 0 ? 3 : is.colors, is.depth_channels};
  arguments.cut_offs = {is.bounded ? T(std::log2(1.0 / 255.0)) : T(-1e30), T(0.990001), T(0.99),
                      T(1e-4)};
  arguments.background = scene.background.data();
  arguments.pixel_weights = or_null(scene.pixel_weights);
  arguments.most_pairs = int64_t(1) << 30;
  arguments.threads = threads;
  return arguments;
}

/// All that rendering a scene and going back gives, one array after another.
template <typename T>
struct Results {
  std::vector<const char*> names;
  std::vector<std::vector<T>> arrays;
  std::vector<uint8_t> visible;

  /// Room that is full of a number which nothing may leave there.
  T* add(const char* name, int64_t size) {
    names.push_back(name);
    arrays.emplace_back(static_cast<size_t>(size), T(12345));
    return arrays.back().data();
  }
};

/// Room for all gradients of a scene.
template <typename T>
ProjectGradients<T> gradients_of(const Scene<T>& scene, Results<T>& results) {
  const int64_t n = scene.is.count;
  const bool all = scene.is.everything;
  const auto gradient = [&](const char* name, const std::vector<T>& array) -> T* {
    return array.empty() ? nullptr : results.add(name, int64_t(array.size()));
  };
  return {{gradient("means", scene.means), gradient("quats", scene.quats),
           gradient("scales", scene.scales), gradient("covariances", scene.covariances),
           gradient("opacities", scene.opacities), gradient("colors", scene.colors),
           gradient("rest", scene.rest), gradient("extra", scene.extra)},
          false,
          all ? results.add("pose", POSE_FIELDS) : nullptr,
          all ? results.add("screen gradient", n) : nullptr,
          all ? results.add("absolute gradient", n) : nullptr};
}

template <typename T>
Results<T> render(const Scene<T>& scene, int threads) {
  const Case& is = scene.is;
  const int64_t n = is.count, pixels = int64_t(is.width) * is.height;
  Results<T> results;
  results.visible.assign(static_cast<size_t>(n), 77);
  const BlendOutputs<T> blended = {results.add("image", pixels * scene.channels),
                                   results.add("alpha", pixels),
                                   is.everything ? results.add("contribution", n) : nullptr};
  const RenderOutputs<T> outputs = {blended, results.visible.data(), results.add("radii", n)};
  RenderPass<T> rendering(arguments_of(scene, threads), outputs);
  RenderGradients<T> gradients = {scene.image_gradient.data(), or_null(scene.alpha_gradient),
                                  gradients_of(scene, results)};
  rendering.backward(gradients);
  if (is.everything) {
    gradients.projected.accumulate = true;
    rendering.backward(gradients);
  }
  return results;
}

/// The same scene in bands of one tile, whose splats come from one array and whose sums go back.
template <typename T>
Results<T> render_in_bands(const Scene<T>& scene, int threads) {
  const Case& is = scene.is;
  const int64_t n = is.count, pixels = int64_t(is.width) * is.height;
  const RenderArguments<T> arguments = arguments_of(scene, threads);
  Results<T> results;
  results.visible.assign(static_cast<size_t>(n), 77);
  T* image = results.add("image", pixels * scene.channels);
  T* alpha = results.add("alpha", pixels);
  T* radii = results.add("radii", n);
  BandedRows<T> rows(arguments.view, arguments.splats, arguments.cut_offs.level_min, TILE, threads,
                     results.visible.data(), radii);
  int64_t total = 0;
  for (const int64_t count : rows.counts()) total += count;
  const int fields = sent_fields(scene.channels);
  const int measured = is.everything ? 3 : 0;
  const int stride = SLOT_CHANNELS + scene.channels + measured;
  std::vector<T> packed(total * fields), sums(total * stride, T(12345));
  rows.pack(packed.data());
  int64_t first = 0;
  for (size_t number = 0; number < rows.counts().size(); ++number) {
    const int64_t count = rows.counts()[number], top = int64_t(number) * TILE;
    BlendArguments<T> blending = arguments.blending();
    blending.height = std::min<int>(TILE, is.height - int(top));
    if (blending.pixel_weights) blending.pixel_weights += top * is.width;
    std::vector<T> contribution(count), own(count * (stride - (measured ? 1 : 0)));
    Band<T> band(packed.data() + first * fields, count, int(top), blending,
                 {image + top * is.width * scene.channels, alpha + top * is.width,
                  measured ? contribution.data() : nullptr});
    const T* by_alpha = or_null(scene.alpha_gradient);
    band.backward({scene.image_gradient.data() + top * is.width * scene.channels,
                   by_alpha ? by_alpha + top * is.width : nullptr, measured > 0},
                  own.data());
    for (int64_t row = 0; row < count; ++row) {
      const int width = stride - (measured ? 1 : 0);
      T* to = sums.data() + (first + row) * stride;
      std::copy_n(own.data() + row * width, width, to);
      if (measured) to[width] = contribution[row];
    }
    first += count;
  }
  const ProjectGradients<T> gradients = gradients_of(scene, results);
  rows.backward(sums.data(), stride, gradients,
                is.everything ? results.add("contribution", n) : nullptr);
  return results;
}

template <typename T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

/// Whether two results are the same to the bit; says which array is not.
template <typename T>
bool same(const std::string& where, const Results<T>& a, const Results<T>& b) {
  bool equal = same_bits(a.visible, b.visible);
  if (!equal) fail(where + ": other splats are visible");
  for (size_t i = 0; i < a.arrays.size(); ++i) {
    if (same_bits(a.arrays[i], b.arrays[i])) continue;
    fail(where + ": " + a.names[i] + " differs");
    equal = false;
  }
  return equal;
}

/// Errors of float32, relative to the length of each array: a splat may miss a pixel at whose edge
/// it hardly shows.
template <typename T, typename U>
void compare(const std::string& where, const Results<T>& found, const Results<U>& exact) {
  for (size_t i = 0; i < found.arrays.size(); ++i) {
    double error = 0, length = 0;
    for (size_t k = 0; k < found.arrays[i].size(); ++k) {
      const double difference = double(found.arrays[i][k]) - double(exact.arrays[i][k]);
      error += difference * difference;
      length += double(exact.arrays[i][k]) * double(exact.arrays[i][k]);
    }
    if (std::sqrt(error) <= 0.01 * std::sqrt(length) + 1e-6) continue;
    fail(where + ": " + found.names[i] + " is off by " + std::to_string(std::sqrt(error / length)));
  }
}

template <typename T>
Results<T> draw_repeatedly(const std::string& where, const Scene<T>& scene) {
  release_render_memory();  // What a larger scene left would hide a step over the end.
  const Results<T> first = render(scene, 1);
  for (const int threads : {1, 2, 5}) {
    same(where + " on " + std::to_string(threads) + " threads", first, render(scene, threads));
  }
  const Results<T> bands = render_in_bands(scene, 1);
  same(where + " in bands", bands, render_in_bands(scene, 3));
  if (!scene.is.everything && !scene.is.hostile) compare(where + " in bands", bands, first);
  return first;
}

void check_case(const Case& is) {
  const Scene<double> exact_scene = make_scene<double>(is);
  const Scene<float> scene = make_scene<float>(is);
  const Results<double> exact = draw_repeatedly(std::string(is.name) + ", float64", exact_scene);
  for (const std::string& set : instruction_sets()) {
    use_instruction_set(set);
    const std::string where = std::string(is.name) + ", " + set;
    const Results<float> found = draw_repeatedly(where, scene);
    if (!is.hostile) compare(where, found, exact);
  }
}

/// Too many pairs are refused, and rendering goes on afterwards.
void check_refusal() {
  const Scene<float> scene = make_scene<float>(CASES[5]);
  const Results<float> before = render(scene, 2);
  Results<float> room = before;
  RenderArguments<float> arguments = arguments_of(scene, 2);
  arguments.most_pairs = 3;
  try {
    RenderPass<float>(arguments, {{room.arrays[0].data(), room.arrays[1].data(), nullptr},
                                  room.visible.data(), room.arrays[2].data()});
    fail("too many pairs were not refused");
  } catch (const TooManyPairs& refused) {
    if (refused.count <= 3) fail("refused " + std::to_string(refused.count) + " pairs");
  }
  same("after a refusal", before, render(scene, 2));
}

void check_two_callers() {
  const Scene<float> scene = make_scene<float>(CASES[5]);
  const Results<float> expected = render(scene, 3);
  Results<float> other;
  std::thread caller([&] { other = render(scene, 2); });
  same("beside another caller", expected, render(scene, 3));
  caller.join();
  same("the other caller", expected, other);
}

/// A child of a process whose threads are idle.
void check_fork() {
  const Scene<float> scene = make_scene<float>(CASES[5]);
  const Results<float> expected = render(scene, 3);
  const pid_t child = fork();
  if (child == 0) _exit(same("in a child", expected, render(scene, 3)) ? 0 : 1);
  int status = 1;
  waitpid(child, &status, 0);
  if (status != 0) fail("the child of a fork failed");
  same("after a fork", expected, render(scene, 3));
}

}  // namespace
}  // namespace gsfw

int main(int count, char** arguments) {
  const bool emulated = count > 1 && std::strcmp(arguments[1], "emulated") == 0;
  for (const gsfw::Case& is : gsfw::CASES) gsfw::check_case(is);
  gsfw::check_refusal();
  gsfw::check_two_callers();
  if (!emulated) gsfw::check_fork();
  gsfw::release_render_memory();
  if (gsfw::failures) std::printf("%d failures in all\n", gsfw::failures);
  return gsfw::failures ? 1 : 0;
}
