#include "render_pass.h"

#include <cstring>

#include "bands.h"

namespace gsfw {

template <typename T>
RenderPass<T>::RenderPass(const RenderArguments<T>& arguments, const RenderOutputs<T>& outputs)
    : project_(arguments.view, arguments.splats, arguments.cut_offs.level_min, arguments.threads,
               outputs.radii),
      blend_(arguments.blending(), project_.projected(), outputs.blended) {
  // The caller's copy may change before the backward pass.
  const int64_t count = arguments.splats.count;
  if (count > 0) std::memcpy(outputs.visible, project_.visible(), count);
}

template <typename T>
void RenderPass<T>::backward(const RenderGradients<T>& gradients) {
  const bool absolute = gradients.projected.absgrad != nullptr;
  const auto slots = blend_.backward({gradients.image, gradients.alpha, absolute});
  project_.backward(slots.sums, gradients.projected);
}

template <typename T>
StageTimes RenderPass<T>::times() const {
  StageTimes found = blend_.times();
  for (const Stage stage : {PROJECT, PROJECT_BACKWARD}) found[stage] = project_.times()[stage];
  return found;
}

template class RenderPass<float>;
template class RenderPass<double>;

void release_render_memory() {
  ProjectPass<float>::release_memory();
  ProjectPass<double>::release_memory();
  BlendPass<float>::release_memory();
  BlendPass<double>::release_memory();
  BandedRows<float>::release_memory();
  BandedRows<double>::release_memory();
  Band<float>::release_memory();
  Band<double>::release_memory();
}

}  // namespace gsfw
