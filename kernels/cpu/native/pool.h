// Threads that live as long as the process and share out numbered tasks.
#pragma once

#include <cstdint>

namespace gsfw {

/// A body of ``run``: does task ``task`` on worker ``worker``, which is less than ``threads``.
using TaskBody = void (*)(void* context, int64_t task, int worker);

/// Do tasks 0 to ``tasks`` - 1 on up to ``threads`` threads, the caller's being worker 0; each
/// thread takes the next number when it is free, so heavy tasks should have low numbers. Returns
/// when all are done. A call from within a task does its tasks on the spot. What a task throws is
/// thrown here, once no other is running; further tasks are then left undone.
void run_tasks(int64_t tasks, int threads, TaskBody body, void* context);

/// ``run_tasks`` for a function object ``f(task, worker)``.
template <typename F>
void parallel(int64_t tasks, int threads, F&& f) {
  auto body = [](void* context, int64_t task, int worker) {
    (*static_cast<F*>(context))(task, worker);
  };
  run_tasks(tasks, threads, body, &f);
}

/// ``parallel`` over [0, count) in pieces of ``grain``: ``f(begin, end, worker)``. The pieces do
/// not depend on the number of threads.
template <typename F>
void parallel_pieces(int64_t count, int64_t grain, int threads, F&& f) {
  parallel((count + grain - 1) / grain, threads, [&](int64_t piece, int worker) {
    const int64_t begin = piece * grain;
    f(begin, begin + grain < count ? begin + grain : count, worker);
  });
}

/// Threads that were started so far, the caller's not counted.
int started_threads();

}  // namespace gsfw
