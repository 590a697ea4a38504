"""The CPU rasterizer: hands splats to the native kernels, and gradients back to torch."""

from __future__ import annotations

from collections.abc import Mapping

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
    unavailable,
)
from gsfw.rasterizers.cpu.painter import CpuPainter
from gsfw.rasterizers.drawing import draw
from gsfw.rasterizers.painter import StageLog


class CpuRasterizer(Rasterizer):
    """Draws in float32 and float64 with every core; the same bits for any number of threads."""

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

    def _draw(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        if splats.means.device.type != "cpu":
            raise ValueError(
                f"splats.means: expected a tensor on the CPU, found one on {splats.means.device}"
            )
        return draw(CpuPainter(), self._log, self.pairs_mb, splats, cameras, settings)
