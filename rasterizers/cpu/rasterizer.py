"""The CPU rasterizer: hands splats to the native kernels, and gradients back to torch."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.cpu.native_module import (
    NOT_BUILT,
    instruction_set,
    instruction_sets,
    unavailable,
)
from gsfw.rasterizers.cpu.drawing import StageLog, draw
from gsfw.rasterizers.cpu.request import request_of


class CpuRasterizer(Rasterizer):
    """Draws in float32 and float64 with every core; the same bits for any number of threads."""

    def __init__(self, pairs_mb: float = 4096.0) -> None:
        self.pairs_mb = pairs_mb
        self._log = StageLog()

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything, except lens distortion; unavailable where the native module is not built."""
        sets = instruction_sets()
        return Capabilities(
            devices=frozenset({"cpu"}),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature) - {Feature.DISTORTION},
            determinism=Determinism.BITWISE,
            preference=10,
            unavailable="" if sets else (unavailable() or NOT_BUILT),
            details={"instruction set": instruction_set()} if sets else {},
        )

    def stage_times(self) -> Mapping[str, StageTime]:
        """Project, sort, bin, blend, and (0 until run) blend_backward, project_backward."""
        return dict(self._log)

    def _draw(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        if cameras.distortion is not None:
            raise ValueError(
                "cameras.distortion: expected None, because the cpu rasterizer draws without lens "
                "distortion; undistort the images first"
            )
        if cameras.intrinsics.requires_grad and torch.is_grad_enabled():
            raise ValueError(
                "cameras.intrinsics: expected a tensor without gradient, because the cpu "
                "rasterizer has none by intrinsics; use the reference rasterizer"
            )
        if splats.means.device.type != "cpu":
            raise ValueError(
                f"splats.means: expected a tensor on the CPU, found one on {splats.means.device}"
            )
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        request = request_of(splats, cameras, settings, statistics, self.pairs_mb)
        image, alpha = draw(request, self._log, _inputs(splats, cameras))
        return _output(image, alpha[..., None], splats, settings, statistics)


def _inputs(splats: Splats, cameras: Cameras) -> list[Tensor | None]:
    """The tensors of ``drawing.INPUTS``, contiguous, colours in flat rows."""
    colors, rest = splats.colors, None
    if isinstance(colors, Sh):
        if colors.offsets is not None:
            colors = Sh(colors.dense(), colors.degree)
        rest = None if colors.rest is None or colors.degree == 0 else colors.rest.flatten(1)
        colors = colors.coefficients.flatten(1)
    tensors = [splats.means, splats.quats, splats.scales, splats.covariances, splats.opacities]
    tensors += [colors, rest, splats.extra, cameras.world_to_camera]
    return [None if tensor is None else tensor.contiguous() for tensor in tensors]


def _output(
    image: Tensor,
    alpha: Tensor,
    splats: Splats,
    settings: RenderSettings,
    statistics: RenderStatistics,
) -> RenderOutput:
    """Take the drawn channels apart."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    color, extra, depth = image, None, None
    if image.shape[-1] > splats.channels:
        color, extra, depth = image.tensor_split([splats.channels, splats.channels + extras], dim=3)
    if settings.background is not None and settings.background.requires_grad:
        color = color + (1.0 - alpha) * settings.background
    if depth is not None and settings.depth is Depth.EXPECTED:
        depth = depth[..., :1] / depth[..., 1:].clamp(min=settings.profile.depth_epsilon)
    return RenderOutput(
        color=color,
        alpha=alpha,
        statistics=statistics,
        depth=None if settings.depth is Depth.NONE else depth,
        extra=None if splats.extra is None else extra,
    )
