#include "pool.h"

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif

#if defined(__x86_64__) || defined(_M_X64)
#include <immintrin.h>
#endif

namespace gsfw {
namespace {

void pause_briefly() {
#if defined(__x86_64__) || defined(_M_X64)
  _mm_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

/// Polls of a waiting worker before it sleeps: some 20 microseconds, the gap between two
/// stages of a step. Longer spinning would take the core from torch's own threads.
constexpr int LOOKS = 600;

/// State shared by all workers of one call.
struct Work {
  TaskBody body;
  void* context;
  int64_t tasks;
  int threads;
};

class Pool {
 public:
  void run(const Work& work) {
    std::lock_guard<std::mutex> one_at_a_time(callers_);
    start(work.threads - 1);
    {
      std::lock_guard<std::mutex> lock(mutex_);
      work_ = work;
      open_ = true;
      next_.store(0, std::memory_order_relaxed);
      generation_.fetch_add(1, std::memory_order_release);
    }
    wake_.notify_all();
    take_tasks(work);
    {
      // A worker that wakes up too late is not waited for.
      std::lock_guard<std::mutex> lock(mutex_);
      open_ = false;
    }
    while (joined_.load(std::memory_order_acquire) > 0) pause_briefly();
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

  int started() const { return started_.load(); }

 private:
  void start(int wanted) {
    while (started_.load() < wanted) {
      const int worker = started_.load() + 1;
      try {
        std::thread([this, worker, seen = generation_.load()] { serve(worker, seen); }).detach();
      } catch (const std::system_error&) {
        return;  // Fewer threads do the same work.
      }
      started_.store(worker);
    }
  }

  void serve(int worker, uint64_t seen) {
    for (;;) {
      for (int look = 0; look < LOOKS; ++look) {
        if (generation_.load(std::memory_order_acquire) != seen) break;
        pause_briefly();
      }
      Work work;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [&] { return generation_.load(std::memory_order_relaxed) != seen; });
        seen = generation_.load(std::memory_order_relaxed);
        if (!open_ || worker >= work_.threads) continue;
        work = work_;
        joined_.fetch_add(1, std::memory_order_relaxed);
      }
      take_tasks(work, worker);
      joined_.fetch_sub(1, std::memory_order_release);
    }
  }

  void take_tasks(const Work& work, int worker = 0);

  /// Keep the first exception of a task for the caller, and leave the remaining tasks undone.
  void fail(const Work& work) {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!failure_) failure_ = std::current_exception();
    next_.store(work.tasks, std::memory_order_relaxed);
  }

  std::mutex callers_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<int> started_{0};
  Work work_{};
  bool open_ = false;
  std::exception_ptr failure_;
  std::atomic<int64_t> next_{0};
  std::atomic<int> joined_{0};
  std::atomic<uint64_t> generation_{0};
};

thread_local bool inside_task = false;

void Pool::take_tasks(const Work& work, int worker) {
  inside_task = true;
  for (;;) {
    const int64_t task = next_.fetch_add(1, std::memory_order_relaxed);
    if (task >= work.tasks) break;
    try {
      work.body(work.context, task, worker);
    } catch (...) {
      fail(work);
    }
  }
  inside_task = false;
}

// Never destroyed: workers may still wait on it while the process ends, and after a fork the child
// has none of the threads and starts a pool of its own.
Pool* pool = nullptr;
std::once_flag made;

void make_pool() {
  pool = new Pool;
#if defined(__unix__) || defined(__APPLE__)
  pthread_atfork(nullptr, nullptr, [] { pool = new Pool; });
#endif
}

}  // namespace

void run_tasks(int64_t tasks, int threads, TaskBody body, void* context) {
  if (threads > tasks) threads = static_cast<int>(tasks);
  if (threads <= 1 || inside_task) {
    for (int64_t task = 0; task < tasks; ++task) body(context, task, 0);
    return;
  }
  std::call_once(made, make_pool);
  pool->run({body, context, tasks, threads});
}

int started_threads() { return pool ? pool->started() : 0; }

}  // namespace gsfw
