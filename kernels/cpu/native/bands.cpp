#include "bands.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "pool.h"

namespace gsfw {
namespace {

/// The first and the last band that a splat may reach; none where the last is before the first.
struct BandRange {
  int first, last;
};

/// Rounded outwards: binning decides exactly.
template <typename T>
BandRange reached_bands(const T* splat, int band_height, int bands) {
  const T half = splat[SPLAT_HEIGHT], slack = T(SLACK) + T(0.01 * SLACK) * half;
  const T low = (splat[SPLAT_Y] - half - slack) / T(band_height);
  const T high = (splat[SPLAT_Y] + half + slack) / T(band_height);
  // Clamped before they become integers, which hold no infinity.
  return {int(low > T(0) ? std::min(low, T(bands)) : T(0)),
          high >= T(0) ? int(std::min(high, T(bands - 1))) : -1};
}

}  // namespace

template <typename T>
BandedRows<T>::BandedRows(const ViewParameters<T>& view, const SplatArrays<T>& splats, T level_min,
                          int band_height, int threads, uint8_t* visible, T* radii)
    : project_(view, splats, level_min, threads, radii),
      rows_(splats.count),
      bands_((view.height + band_height - 1) / band_height),
      band_height_(band_height),
      channels_(channels_of(splats)),
      threads_(threads),
      bounded_(view.alpha_min > T(0)) {
  if (rows_ > 0) std::memcpy(visible, project_.visible(), rows_);
  divide();
}

/// Find the bands of each row, and the places of what is sent to them.
template <typename T>
void BandedRows<T>::divide() {
  const ProjectedSplats<T> splats = project_.projected();
  const int64_t tasks = (rows_ + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  slot_starts_.assign(rows_ + 1, 0);
  first_bands_.resize(rows_);
  task_starts_.assign(tasks * bands_, 0);
  parallel_pieces(rows_, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int) {
    int64_t* counts = task_starts_.data() + begin / ROWS_PER_TASK * bands_;
    for (int64_t row = begin; row < end; ++row) {
      if (!splats.visible[row]) continue;
      const BandRange range =
          bounded_ ? reached_bands(splats.fields + row * splats.stride, band_height_, bands_)
                   : BandRange{0, bands_ - 1};
      first_bands_[row] = static_cast<uint16_t>(range.first);
      slot_starts_[row + 1] = static_cast<uint32_t>(std::max(range.last - range.first + 1, 0));
      for (int band = range.first; band <= range.last; ++band) ++counts[band];
    }
  });
  for (int64_t row = 0; row < rows_; ++row) slot_starts_[row + 1] += slot_starts_[row];
  counts_.assign(bands_, 0);
  int64_t total = 0;
  for (int band = 0; band < bands_; ++band) {
    const int64_t before = total;
    for (int64_t task = 0; task < tasks; ++task) {
      total += std::exchange(task_starts_[task * bands_ + band], total);
    }
    counts_[band] = total - before;
  }
}

/// Call ``f(row, slot, place)`` for every splat that is sent.
template <typename T>
template <typename F>
void BandedRows<T>::for_each_sent(const F& f) const {
  parallel_pieces(rows_, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int) {
    const int64_t* starts = task_starts_.data() + begin / ROWS_PER_TASK * bands_;
    std::vector<int64_t> places(starts, starts + bands_);
    for (int64_t row = begin; row < end; ++row) {
      const uint32_t first = slot_starts_[row], behind = slot_starts_[row + 1];
      int64_t* place = places.data() + first_bands_[row];
      for (uint32_t slot = first; slot < behind; ++slot) f(row, slot, (*place++)++);
    }
  });
}

template <typename T>
void BandedRows<T>::pack(T* to) {
  if (!project_.holds()) throw std::logic_error("the projected splats were packed before");
  const ProjectedSplats<T> splats = project_.projected();
  const int fields = SPLAT_CHANNELS + channels_;
  for_each_sent([&](int64_t row, uint32_t, int64_t place) {
    T* packed = to + place * (fields + 1);
    std::memcpy(packed, splats.fields + row * splats.stride, fields * sizeof(T));
    packed[fields] = splats.depths[row];
  });
  project_.release();
}

template <typename T>
void BandedRows<T>::backward(const T* sums, int stride, const ProjectGradients<T>& gradients,
                             T* contribution) {
  const auto memory = Recycler<SlotMemory>::instance().take();
  // A row of slots is read in whole packs.
  T* slots = memory->slots.reserve(int64_t(slot_starts_[rows_]) * stride + 16);
  for_each_sent([&](int64_t, uint32_t slot, int64_t place) {
    std::memcpy(slots + int64_t(slot) * stride, sums + place * stride, stride * sizeof(T));
  });
  project_.backward({slot_starts_.data(), slots, stride}, gradients);
  if (!contribution) return;
  parallel_pieces(rows_, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int) {
    for (int64_t row = begin; row < end; ++row) {
      T sum = 0;
      for (uint32_t slot = slot_starts_[row]; slot < slot_starts_[row + 1]; ++slot) {
        sum += slots[int64_t(slot) * stride + stride - 1];
      }
      contribution[row] = sum;
    }
  });
}

template <typename T>
Band<T>::Band(const T* rows, int64_t count, int top, const BlendArguments<T>& arguments,
              const BlendOutputs<T>& outputs)
    : channels_(arguments.channels),
      threads_(arguments.threads),
      memory_(Recycler<RowMemory>::instance().take()),
      blend_(arguments, unpack(rows, count, top), outputs) {}

template <typename T>
ProjectedSplats<T> Band<T>::unpack(const T* rows, int64_t count, int top) {
  const int fields = SPLAT_CHANNELS + channels_, stride = projected_stride(channels_);
  T* to = memory_->fields.reserve(count * stride);
  T* depths = memory_->depths.reserve(count);
  uint8_t* visible = memory_->visible.reserve(count);
  parallel_pieces(count, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int) {
    std::fill(visible + begin, visible + end, uint8_t(1));
    for (int64_t row = begin; row < end; ++row) {
      const T* packed = rows + row * (fields + 1);
      T* splat = to + row * stride;
      std::memcpy(splat, packed, fields * sizeof(T));
      std::fill(splat + fields, splat + stride, T(0));
      splat[SPLAT_Y] -= T(top);
      depths[row] = packed[fields];
    }
  });
  return {count, to, stride, depths, visible};
}

template <typename T>
void Band<T>::backward(const BlendGradients<T>& gradients, T* sums) {
  const typename BlendPass<T>::Slots found = blend_.backward(gradients);
  const uint32_t* starts = found.sums.starts;
  const T* slots = found.sums.slots;
  const int stride = found.sums.stride;
  const int64_t count = blend_.num_splats();
  parallel_pieces(count, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int) {
    for (int64_t row = begin; row < end; ++row) {
      T* to = sums + row * stride;
      std::fill(to, to + stride, T(0));
      for (int64_t slot = starts[row]; slot < starts[row + 1]; ++slot) {
        for (int k = 0; k < stride; ++k) to[k] += slots[slot * stride + k];
      }
    }
  });
}

template class BandedRows<float>;
template class BandedRows<double>;
template class Band<float>;
template class Band<double>;

}  // namespace gsfw
