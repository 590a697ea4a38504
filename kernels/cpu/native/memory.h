// Memory that is kept from one image to the next: fresh pages cost more than what is rendered in
// them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace gsfw {

/// Have a large block in pages of 2 MB, where the system gives them on request. Blocks that are
/// read or written out of order otherwise wait for their pages' addresses more than for memory.
inline void prefer_large_pages([[maybe_unused]] void* block, [[maybe_unused]] size_t bytes) {
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  constexpr uintptr_t PAGE = uintptr_t(2) << 20;
  const uintptr_t begin = (reinterpret_cast<uintptr_t>(block) + PAGE - 1) / PAGE * PAGE;
  const uintptr_t end = (reinterpret_cast<uintptr_t>(block) + bytes) / PAGE * PAGE;
  // A hint: where it is refused, small pages do.
  if (end > begin) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

/// Bytes from which a block has pages of its own.
constexpr size_t OWN_PAGES = size_t(1) << 20;

/// A block that stays from one image to the next, aligned to a cache line; throws std::bad_alloc.
/// A large one has pages of its own: within the heap it would part what each step frees around it,
/// so that the heap has to grow for the next large block.
inline void* take_block(size_t bytes) {
#if defined(__linux__)
  if (bytes >= OWN_PAGES) {
    void* block = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (block == MAP_FAILED) throw std::bad_alloc();
    prefer_large_pages(block, bytes);
    return block;
  }
#endif
  return ::operator new(bytes, std::align_val_t{64});
}

/// Free a block of ``take_block``, of the same size.
inline void free_block(void* block, [[maybe_unused]] size_t bytes) {
#if defined(__linux__)
  if (bytes >= OWN_PAGES) {
    munmap(block, bytes);
    return;
  }
#endif
  ::operator delete(block, std::align_val_t{64});
}

/// An array that only grows, without keeping its contents; aligned to a cache line.
template <typename T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  ~Buffer() { release(); }

  /// Room for ``size`` elements; throws std::bad_alloc.
  T* reserve(size_t size) {
    if (size > size_) {
      release();
      const size_t wanted = size + size / 8;
      data_ = static_cast<T*>(take_block(wanted * sizeof(T)));
      size_ = wanted;
    }
    return data_;
  }

  /// The same, keeping the first ``used`` elements; grows in steps that double.
  T* grow(size_t used, size_t size) {
    if (size > size_) {
      Buffer larger;
      larger.reserve(size > 2 * size_ ? size : 2 * size_);
      if (used) std::memcpy(larger.data_, data_, used * sizeof(T));
      std::swap(data_, larger.data_);
      std::swap(size_, larger.size_);
    }
    return data_;
  }

  T* get() const { return data_; }

 private:
  void release() {
    if (data_) free_block(data_, size_ * sizeof(T));
    data_ = nullptr;
    size_ = 0;
  }

  T* data_ = nullptr;
  size_t size_ = 0;
};

/// Hands out objects that nobody uses, and makes new ones when there are none.
template <typename W>
class Recycler {
 public:
  struct Return {
    void operator()(W* object) const { Recycler::instance().give(object); }
  };
  using Lease = std::unique_ptr<W, Return>;

  /// Never destroyed: a lease may outlive every other static object.
  static Recycler& instance() {
    static Recycler* only = new Recycler;
    return *only;
  }

  Lease take() {
    std::lock_guard<std::mutex> lock(mutex_);
    if (idle_.empty()) return Lease(new W);
    W* object = idle_.back();
    idle_.pop_back();
    return Lease(object);
  }

  /// Free what nobody uses.
  void clear() {
    std::lock_guard<std::mutex> lock(mutex_);
    for (W* object : idle_) delete object;
    idle_.clear();
  }

 private:
  void give(W* object) {
    std::lock_guard<std::mutex> lock(mutex_);
    idle_.push_back(object);
  }

  std::mutex mutex_;
  std::vector<W*> idle_;
};

/// Let the process's allocator keep what is freed, where it can be told to: blocks above a limit
/// would otherwise go back to the system and come again as fresh pages in every step.
inline void keep_freed_memory() {
#if defined(__GLIBC__)
  // Older versions refuse more than 32 MB, and after any call they no longer adapt by themselves.
  if (!mallopt(M_MMAP_THRESHOLD, 1 << 30)) mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
#endif
}

}  // namespace gsfw
