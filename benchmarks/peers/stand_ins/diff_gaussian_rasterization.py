"""Stand-in for diff-gaussian-rasterization: the original rasterizer's interface on gsfw's engine.

It has the interface of the extension of Kerbl et al. 2023 (settings, a module, image and radii),
which the original trainer and most that grew from it import. Differences: the radius of a splat is
half of its exact bounding box, not three standard deviations; tiles, cut-offs and the gradient of
the alpha clamp are gsfw's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.cameras import Cameras
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import RenderSettings, Statistic, Validation
from gsfw.core.splats import Sh, Splats
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

NEAR = 0.2
"""The original's near plane (auxiliary.h, in_frustum)."""
RASTERIZER = CpuRasterizer()


class GaussianRasterizationSettings(NamedTuple):
    """A view, with the original's names."""

    image_height: int
    image_width: int
    tanfovx: float
    tanfovy: float
    bg: Float[Tensor, " 3"]
    scale_modifier: float
    viewmatrix: Float[Tensor, "4 4"]
    """World to camera, transposed."""
    projmatrix: Float[Tensor, "4 4"]
    """Follows from the others; not read."""
    sh_degree: int
    campos: Float[Tensor, " 3"]
    """Follows from ``viewmatrix``; not read."""
    prefiltered: bool
    debug: bool

    def camera(self) -> Cameras:
        """The camera of the view, whose principal point is the middle of the image."""
        matrix = torch.eye(3)
        matrix[0, 0] = self.image_width / (2 * self.tanfovx)
        matrix[1, 1] = self.image_height / (2 * self.tanfovy)
        matrix[0, 2], matrix[1, 2] = self.image_width / 2, self.image_height / 2
        pose = self.viewmatrix.T.contiguous()
        return Cameras(pose[None], matrix[None], self.image_width, self.image_height)


class GaussianRasterizer(nn.Module):
    """Renders one view."""

    def __init__(self, raster_settings: GaussianRasterizationSettings) -> None:
        super().__init__()
        self.raster_settings = raster_settings

    def forward(
        self,
        means3D: Float[Tensor, "n 3"],
        means2D: Float[Tensor, "n 3"],
        opacities: Float[Tensor, "n 1"],
        shs: Float[Tensor, "n k 3"] | None = None,
        colors_precomp: Float[Tensor, "n 3"] | None = None,
        scales: Float[Tensor, "n 3"] | None = None,
        rotations: Float[Tensor, "n 4"] | None = None,
        cov3D_precomp: Float[Tensor, "n 6"] | None = None,
    ) -> tuple[Float[Tensor, "3 h w"], Float[Tensor, " n"]]:
        """Image and radii; backward writes the screen gradient into ``means2D.grad[:, 0]``."""
        view = self.raster_settings
        measured: list[RenderStatistics] = []
        colors = colors_precomp if shs is None else Sh(shs, view.sh_degree)
        assert colors is not None, "give shs or colors_precomp"
        splats = Splats(
            _WithScreenGradient.apply(means3D, means2D, measured),
            opacities[:, 0],
            colors,
            rotations,
            None if scales is None else scales * view.scale_modifier,
            None if cov3D_precomp is None else _matrices(cov3D_precomp),
        )
        settings = RenderSettings(
            background=view.bg,
            near=NEAR,
            statistics=frozenset({Statistic.SCREEN_GRADIENT}),
            validation=Validation.CHEAP,
        )
        output = RASTERIZER.render(splats, view.camera(), settings)
        # The statistics alone: the image would hold this step's graph, which holds the list.
        measured.append(output.statistics)
        return output.color[0].permute(2, 0, 1), output.statistics.radii[0]


class _WithScreenGradient(torch.autograd.Function):
    """Passes the means on, and hands what rendering measured of them to ``means2D.grad``.

    Its backward pass runs after that of the render, which depends on its output; by then the
    statistics are written. Trainers read no more of that gradient than its norm.
    """

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        means: Tensor,
        screen: Tensor,
        measured: list[RenderStatistics],
    ) -> Tensor:
        ctx.measured = measured
        return means.view_as(means)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, None]:  # noqa: ANN401
        (statistics,) = ctx.measured
        screen = torch.zeros_like(gradient)
        assert statistics.screen_gradient is not None, "it was asked for"
        screen[:, 0] = statistics.screen_gradient[0]
        return gradient, screen, None


def _matrices(halves: Float[Tensor, "n 6"]) -> Float[Tensor, "n 3 3"]:
    """Symmetric matrices from their upper halves, row by row."""
    return halves[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].view(-1, 3, 3)
