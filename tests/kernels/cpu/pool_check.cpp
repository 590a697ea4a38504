// Checks of the pool of threads that need no Python, for sanitizers: every task is done once, by a
// worker that may do it, however calls are nested, repeated or made at once.
//
// It prints what is not so and exits with 1, or exits with 0.
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <thread>
#include <vector>

#include "pool.h"

namespace gsfw {
namespace {

int failures = 0;

void fail(const char* what, int64_t tasks, int threads) {
  ++failures;
  std::printf("%s: %lld tasks on %d threads\n", what, static_cast<long long>(tasks), threads);
}

/// Every task writes a number of its own, with nothing to guard it: the pool must make what tasks
/// write seen by the caller.
bool every_task_is_done_once(int64_t tasks, int threads) {
  std::vector<int> done(static_cast<size_t>(tasks)), workers(static_cast<size_t>(tasks));
  parallel(tasks, threads, [&](int64_t task, int worker) {
    ++done[size_t(task)];
    workers[size_t(task)] = worker;
  });
  for (size_t task = 0; task < done.size(); ++task) {
    if (done[task] != 1 || workers[task] < 0 || workers[task] >= threads) return false;
  }
  return true;
}

/// Memory of a worker is its own while a call lasts.
bool workers_do_one_task_at_a_time(int64_t tasks, int threads) {
  std::vector<int64_t> sums(size_t(threads), 0);
  parallel(tasks, threads, [&](int64_t task, int worker) { sums[size_t(worker)] += task; });
  int64_t total = 0;
  for (const int64_t sum : sums) total += sum;
  return total == tasks * (tasks - 1) / 2;
}

bool nested_calls_are_done(int64_t tasks, int threads) {
  std::vector<int64_t> sums(size_t(tasks), 0);
  parallel(tasks, threads, [&](int64_t outer, int) {
    parallel(outer, threads, [&](int64_t inner, int worker) {
      if (worker == 0) sums[size_t(outer)] += inner;
    });
  });
  for (int64_t outer = 0; outer < tasks; ++outer) {
    if (sums[size_t(outer)] != outer * (outer - 1) / 2) return false;
  }
  return true;
}

bool pieces_cover_everything(int64_t count, int threads) {
  std::vector<int> covered(size_t(count), 0);
  parallel_pieces(count, 7, threads, [&](int64_t begin, int64_t end, int) {
    for (int64_t i = begin; i < end; ++i) ++covered[size_t(i)];
  });
  for (const int times : covered) {
    if (times != 1) return false;
  }
  return true;
}

void check_all(int64_t tasks, int threads) {
  if (!every_task_is_done_once(tasks, threads)) fail("done once", tasks, threads);
  if (!workers_do_one_task_at_a_time(tasks, threads)) fail("own memory", tasks, threads);
  if (!nested_calls_are_done(tasks, threads)) fail("nested", tasks, threads);
  if (!pieces_cover_everything(tasks, threads)) fail("pieces", tasks, threads);
}

/// Each task waits until all have begun, which takes as many threads; what they write is seen.
bool tasks_run_at_once(int threads) {
  std::atomic<int> begun{0};
  std::vector<int> workers(size_t(threads), -1);
  parallel(threads, threads, [&](int64_t task, int worker) {
    begun.fetch_add(1);
    while (begun.load() < threads) std::this_thread::yield();
    workers[size_t(worker)] = int(task);
  });
  for (const int task : workers) {
    if (task < 0) return false;
  }
  return true;
}

/// Calls so short that workers wake up when the next has begun or all are over.
void check_small_calls() {
  for (int call = 0; call < 3000; ++call) {
    const int threads = 1 + call % 4;
    if (!every_task_is_done_once(call % 9, threads)) fail("small call", call % 9, threads);
  }
}

void check_callers_at_once() {
  std::vector<std::thread> callers;
  std::vector<int> bad(3, 0);
  for (int caller = 0; caller < 3; ++caller) {
    callers.emplace_back([&bad, caller] {
      for (int call = 0; call < 200; ++call) {
        bad[size_t(caller)] += !every_task_is_done_once(1 + call % 17, 2 + caller);
      }
    });
  }
  for (std::thread& caller : callers) caller.join();
  for (const int count : bad) {
    if (count) fail("callers at once", count, 3);
  }
}

/// A child has none of its parent's threads and starts its own.
void check_fork() {
  const int before = started_threads();
  const pid_t child = fork();
  if (child == 0) {
    const bool none = started_threads() == 0;
    _exit(none && every_task_is_done_once(100, 3) && started_threads() == 2 ? 0 : 1);
  }
  int status = 1;
  waitpid(child, &status, 0);
  if (status != 0) fail("child of a fork", 100, 3);
  if (started_threads() != before) fail("parent of a fork", 0, before);
  check_all(40, 4);
}

}  // namespace
}  // namespace gsfw

int main() {
  for (const int64_t tasks : {0, 1, 2, 3, 50, 400}) {
    for (const int threads : {1, 2, 3, 8, 2}) gsfw::check_all(tasks, threads);
  }
  if (gsfw::started_threads() != 7) gsfw::fail("threads started", 400, 8);
  for (int round = 0; round < 50; ++round) {
    const int threads = 2 + round % 5;
    if (!gsfw::tasks_run_at_once(threads)) gsfw::fail("at once", threads, threads);
  }
  gsfw::check_small_calls();
  gsfw::check_callers_at_once();
  gsfw::check_fork();
  return gsfw::failures ? 1 : 0;
}
