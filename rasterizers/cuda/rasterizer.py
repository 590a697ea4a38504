"""The CUDA rasterizer: hands splats to the kernels, and gradients back to torch."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.kernels.cuda.availability import unavailable
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.rasterizers.cuda.painter import MOST_CHANNELS, CudaPainter
from gsfw.rasterizers.drawing import draw
from gsfw.rasterizers.painter import StageLog


class CudaRasterizer(Rasterizer):
    """Draws in float32 and float64 on the device of its launcher.

    Pictures have the same bits each time. Gradients have them when ``deterministic``, for which
    every pair of a splat and a tile gets memory of its own; else they are summed in any order.
    """

    def __init__(
        self,
        launcher: Launcher,
        pairs_mb: float = 16384.0,
        deterministic: bool = False,
        time_stages: bool = False,
    ) -> None:
        self.pairs_mb = pairs_mb
        self._painter = CudaPainter(launcher, deterministic, time_stages)
        self._log = StageLog()

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything; with the settings' determinism see the config."""
        return Capabilities(
            devices=frozenset({"cuda"}),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature),
            max_channels=MOST_CHANNELS,
            determinism=Determinism.NONE,
            preference=20,
            unavailable=unavailable(),
        )

    def stage_times(self) -> Mapping[str, StageTime]:
        """Project, sort, bin, blend, blend_backward, project_backward; empty unless measured."""
        return dict(self._log)

    def _draw(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        return draw(self._painter, self._log, self.pairs_mb, splats, cameras, settings)
