#include "project_pass.h"

#include "pool.h"

namespace gsfw {

template <typename T>
ProjectPass<T>::ProjectPass(const ViewParameters<T>& view, const SplatArrays<T>& splats,
                            T level_min, int threads, T* radii)
    : threads_(threads),
      projected_(Recycler<ProjectedMemory>::instance().take()),
      visible_(Recycler<VisibleMemory>::instance().take()) {
  const Timed timed(times_[PROJECT]);
  const int stride = projected_stride(channels_of(splats));
  job_ = {view,
          splats,
          level_min,
          projected_->fields.reserve(splats.count * stride),
          stride,
          projected_->depths.reserve(splats.count),
          visible_->rows.reserve(splats.count),
          radii};
  const RenderKernels<T>& kernels = render_kernels<T>();
  parallel_pieces(splats.count, ROWS_PER_TASK, threads,
                  [&](int64_t begin, int64_t end, int) { kernels.project(job_, begin, end); });
}

template <typename T>
ProjectedSplats<T> ProjectPass<T>::projected() const {
  return {job_.splats.count, job_.projected, job_.stride, job_.depths, job_.visible};
}

template <typename T>
void ProjectPass<T>::backward(const SlotSums<T>& sums, const ProjectGradients<T>& gradients) {
  const Timed timed(times_[PROJECT_BACKWARD]);
  const auto memory = Recycler<BackwardMemory>::instance().take();
  const int64_t count = job_.splats.count;
  const int64_t tasks = (count + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  const int64_t size = whole_packs(sums.stride) * 16;
  T* summed = memory->sums.reserve(size * threads_);
  T* pose = gradients.pose ? memory->pose.reserve(tasks * POSE_FIELDS) : nullptr;
  const ProjectBackwardJob<T> job = {job_,
                                     sums.starts,
                                     sums.slots,
                                     sums.stride,
                                     gradients.absgrad != nullptr,
                                     gradients.splats,
                                     gradients.accumulate,
                                     pose,
                                     gradients.screen_gradient,
                                     gradients.absgrad};
  const RenderKernels<T>& kernels = render_kernels<T>();
  parallel_pieces(count, ROWS_PER_TASK, threads_, [&](int64_t begin, int64_t end, int worker) {
    kernels.project_backward(job, begin, end, summed + worker * size);
  });
  for (int k = 0; pose && k < POSE_FIELDS; ++k) {
    double sum = 0;
    for (int64_t task = 0; task < tasks; ++task) sum += double(pose[task * POSE_FIELDS + k]);
    gradients.pose[k] = T(sum);
  }
}

template <typename T>
void ProjectPass<T>::release_memory() {
  Recycler<ProjectedMemory>::instance().clear();
  Recycler<VisibleMemory>::instance().clear();
  Recycler<BackwardMemory>::instance().clear();
}

template class ProjectPass<float>;
template class ProjectPass<double>;

}  // namespace gsfw
