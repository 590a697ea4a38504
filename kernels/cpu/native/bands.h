// Bands: an image in strips of pixel rows, each blended from the splats that reach it.
//
// The rows of a model may be divided among processes, and so may the bands of an image: projected
// splats are sent to the bands that they reach, and the sums of blending are sent back. A row has
// one slot for each band; ``project_backward`` adds them in the order of the bands.
#pragma once

#include <cstdint>
#include <vector>

#include "blend_pass.h"
#include "project_pass.h"

namespace gsfw {

/// Numbers of T that a splat is sent with: its fields without padding, then its depth.
constexpr int sent_fields(int channels) { return SPLAT_CHANNELS + channels + 1; }

/// Some rows of a model, projected into an image and divided by the bands that they reach.
template <typename T>
class BandedRows {
 public:
  /// Projects at once.
  BandedRows(const ViewParameters<T>& view, const SplatArrays<T>& splats, T level_min,
             int band_height, int threads, uint8_t* visible, T* radii);

  /// Splats that reach each band.
  const std::vector<int64_t>& counts() const { return counts_; }

  /// Write the splats [sum of counts, sent_fields], band after band, each in the order of rows;
  /// once, because the projected splats are given back. Throws std::logic_error the second time.
  void pack(T* to);

  /// Go back from the sums of bands [sum of counts, stride], in the order of ``pack``.
  /// ``contribution`` [n], null where not wanted, is the sum of their last column.
  void backward(const T* sums, int stride, const ProjectGradients<T>& gradients, T* contribution);

  /// Free the memory that is kept from image to image.
  static void release_memory() { Recycler<SlotMemory>::instance().clear(); }

 private:
  struct SlotMemory {
    Buffer<T> slots;
  };

  void divide();
  template <typename F>
  void for_each_sent(const F& f) const;

  ProjectPass<T> project_;
  int64_t rows_;
  int bands_, band_height_, channels_, threads_;
  bool bounded_;
  std::vector<int64_t> counts_;
  /// [n + 1]: the first slot of each row, and one behind the last.
  std::vector<uint32_t> slot_starts_;
  /// [n]: the first band of each row.
  std::vector<uint16_t> first_bands_;
  /// [tasks, bands]: the place of the first splat that a task of rows sends to a band.
  std::vector<int64_t> task_starts_;
};

/// One band of an image.
template <typename T>
class Band {
 public:
  /// Blends at once. ``rows`` [count, sent_fields] are as ``BandedRows`` packs them, in any order;
  /// the image of ``arguments`` is the band, whose first pixel row is ``top``.
  Band(const T* rows, int64_t count, int top, const BlendArguments<T>& arguments,
       const BlendOutputs<T>& outputs);

  /// Write the sums [count, SLOT_CHANNELS + channels, and 2 if absolute] of each splat.
  void backward(const BlendGradients<T>& gradients, T* sums);

  /// Free the memory that is kept from image to image.
  static void release_memory() { Recycler<RowMemory>::instance().clear(); }

 private:
  struct RowMemory {
    Buffer<T> fields, depths;
    Buffer<uint8_t> visible;
  };

  ProjectedSplats<T> unpack(const T* rows, int64_t count, int top);

  int channels_, threads_;
  typename Recycler<RowMemory>::Lease memory_;
  BlendPass<T> blend_;
};

}  // namespace gsfw
