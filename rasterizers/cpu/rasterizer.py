"""The CPU rasterizer: native kernels with SIMD, the default where there is no GPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gsfw.core.bands import Bands
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.kernels.cpu.native_module import (
    NOT_BUILT,
    instruction_set,
    instruction_sets,
    native_class,
    required,
    unavailable,
)
from gsfw.kernels.cpu.threads import num_threads
from gsfw.kernels.render_arguments import (
    KernelGradients,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
)
from gsfw.rasterizers.autograd import pair_limit, render
from gsfw.rasterizers.cpu.bands import CpuBands
from gsfw.rasterizers.kernel_backend import ForwardPass, KernelBackend, StageLog, TooManyPairs


class CpuRasterizer(Rasterizer):
    """Renders in float32 and float64 on all cores; the same bits for any number of threads."""

    def __init__(self, pairs_mb: float = 4096.0) -> None:
        self.pairs_mb = pairs_mb
        self._log = StageLog()

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything; unavailable where the native module is not built."""
        sets = instruction_sets()
        return Capabilities(
            devices=frozenset({"cpu"}),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature),
            determinism=Determinism.BITWISE,
            preference=10,
            unavailable="" if sets else (unavailable() or NOT_BUILT),
            details={"instruction set": instruction_set()} if sets else {},
        )

    def stage_times(self) -> Mapping[str, StageTime]:
        """Project, sort, bin, blend, and (0 until run) blend_backward, project_backward."""
        return dict(self._log)

    def bands(
        self, splats: Splats, cameras: Cameras, settings: RenderSettings, pixels: Sequence[range]
    ) -> Bands:
        """Images of which several processes render bands."""
        limit = pair_limit(CpuBackend(), self.pairs_mb, splats, settings)
        return CpuBands(limit, splats, cameras, settings, pixels)

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        if splats.means.device.type != "cpu":
            raise ValueError(
                f"splats.means: expected a tensor on the CPU, found one on {splats.means.device}"
            )
        return render(CpuBackend(), self._log, self.pairs_mb, splats, cameras, settings)


class CpuBackend(KernelBackend):
    """The native kernels, on all cores."""

    name = "cpu"
    max_pairs = 2**32 - 1

    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per tile intersection: unsorted, sorted, and its sums in the backward pass."""
        module = required()
        return module.PAIR_BYTES + (module.SLOT_FIELDS + channels) * element_size

    def render(
        self, inputs: KernelInputs, settings: KernelSettings, outputs: KernelOutputs
    ) -> ForwardPass:
        """Render one image."""
        kind = native_class("RenderPass", outputs.image.dtype)
        try:
            return CpuForwardPass(kind(inputs.detached(), settings, outputs, num_threads()))
        except required().TooManyPairs as refused:
            raise TooManyPairs(refused.args[0]) from None


class CpuForwardPass(ForwardPass):
    """A forward pass in native memory."""

    def __init__(self, rendering: Any) -> None:  # noqa: ANN401 - of one type or the other.
        self._pass = rendering

    def backward(self, gradients: KernelGradients) -> None:
        """Write the gradients of the inputs."""
        self._pass.backward(gradients)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage: summed over all threads, and by the wall clock."""
        return self._pass.times()
