"""The reference rasterizer: project, bin and blend in plain torch, one camera after the other."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.kernel_arguments import DTYPES
from gsfw.rasterizers.reference.bin import bin_ellipses
from gsfw.rasterizers.reference.blend import blend
from gsfw.rasterizers.reference.layers import projected_splats
from gsfw.rasterizers.reference.project import project, view_colors, visible_extents
from gsfw.rasterizers.reference.tile_buffer import CutOffs, Measurements, TileBuffer


@dataclass(frozen=True)
class _Image:
    """Image of one camera."""

    color: Float[Tensor, "h w d"]
    alpha: Float[Tensor, "h w 1"]
    depth: Float[Tensor, "h w z"]
    """z is 1 if asked for, else 0."""
    extra: Float[Tensor, "h w e"]
    """e is 0 where the splats have none."""


class ReferenceRasterizer(Rasterizer):
    """Renders in float32 and float64 on any torch device; the oracle for every other backend."""

    def __init__(self, chunk_mb: float = 4.0, pairs_mb: float = 4096.0) -> None:
        self.chunk_mb = chunk_mb
        self.pairs_mb = pairs_mb

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything."""
        devices = {"cpu"} | ({"cuda"} if torch.cuda.is_available() else set())
        return Capabilities(
            devices=frozenset(devices),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature),
            determinism=Determinism.BITWISE,
            details={"torch": torch.__version__},
        )

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        if splats.means.dtype not in DTYPES:
            raise ValueError(
                f"splats.means: expected float32 or float64, found {splats.means.dtype}"
            )
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        images = [
            self._render_one(splats, cameras.select(slice(i, i + 1)), settings, statistics, i)
            for i in range(len(cameras))
        ]

        depth = torch.stack([image.depth for image in images])
        extra = torch.stack([image.extra for image in images])
        return RenderOutput(
            color=torch.stack([image.color for image in images]),
            alpha=torch.stack([image.alpha for image in images]),
            statistics=statistics,
            depth=None if settings.depth is Depth.NONE else depth,
            extra=None if splats.extra is None else extra,
        )

    def _render_one(
        self,
        splats: Splats,
        camera: Cameras,
        settings: RenderSettings,
        statistics: RenderStatistics,
        index: int,
    ) -> _Image:
        profile = settings.profile
        with torch.no_grad():
            # Visible rows are found first, so that no gradient runs through the others, for which
            # the projection may not even be finite.
            everything = project(splats, camera, settings)
            visible, extents = visible_extents(everything, camera, settings)
            rows = visible.nonzero()[:, 0]
            rows = rows[everything.depths[rows].argsort(stable=True)]
            statistics.visible[index] = visible
            statistics.radii[index, rows] = extents.amax(1)[rows]
        ellipses = project(splats, camera, settings, rows)
        channels = [view_colors(splats, camera, rows)]
        if splats.extra is not None:
            channels.append(splats.extra.index_select(0, rows))
        if settings.depth is not Depth.NONE:
            channels.append(ellipses.depths[:, None])
        if settings.depth is Depth.EXPECTED:
            # The sum of weights, which 1 - transmittance has no digits of where it is small.
            channels.append(torch.ones_like(ellipses.depths)[:, None])
        with torch.no_grad():
            bins = bin_ellipses(ellipses, camera, profile, self.pairs_mb)
            weights = settings.contribution_weights
            pixel_weights = None if weights is None else bins.by_tile(weights[index, :, :, 0])
            buffer = TileBuffer(
                bins,
                bins.inside(camera),
                CutOffs.of(profile, splats.means.dtype),
                self.chunk_mb,
                Measurements.of(statistics, index, rows, camera, pixel_weights),
            )
        blended, left = blend(
            projected_splats(ellipses, torch.cat(channels, dim=1)), buffer, camera
        )
        return _image(blended, left, splats, settings)


def _image(
    blended: Float[Tensor, "h w f"],
    left: Float[Tensor, "h w 1"],
    splats: Splats,
    settings: RenderSettings,
) -> _Image:
    """Take the blended channels apart, and put the background behind the colours."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    color, extra, depth = blended.tensor_split([splats.channels, splats.channels + extras], dim=2)
    if settings.background is not None:
        color = color + left * settings.background
    if settings.depth is Depth.EXPECTED:
        depth = depth[:, :, :1] / depth[:, :, 1:].clamp(min=settings.profile.depth_epsilon)
    return _Image(color, 1 - left, depth, extra)
