"""The ray rasterizer: each Gaussian along the true ray of each pixel, in plain torch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.ray.camera_rays import Rays, rays_of, tiles
from gsfw.rasterizers.ray.gaussians import Gaussians, place, within_reach
from gsfw.rasterizers.ray.mode import Mode, recomputed
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.reference.project import view_colors

LACKING = frozenset({Feature.ANTIALIAS, Feature.SCREEN_GRADIENT, Feature.ABSGRAD})
"""Nothing is projected, so that there is no centre in the image to take a gradient by, and no
projected area to compensate."""

LIVE_TENSORS = 64
"""Numbers per pair of a ray and a Gaussian that are alive at once in the backward pass."""

Part = tuple[Tensor, Tensor, Tensor, Tensor]
"""Channels, depths, weights and what is left, of some rays."""


@dataclass(frozen=True)
class Tally:
    """Statistics of one camera, with a row per splat."""

    contributions: Float[Tensor, " n"]
    lowest: Float[Tensor, "n 2"]
    """Lowest centre of the reached pixels; infinite if there is none."""
    highest: Float[Tensor, "n 2"]

    @staticmethod
    def empty(means: Float[Tensor, "n 3"]) -> Tally:
        """Nothing seen yet."""
        return Tally(
            means.new_zeros(len(means)),
            means.new_full((len(means), 2), torch.inf),
            means.new_full((len(means), 2), -torch.inf),
        )

    def add(
        self,
        rows: Int[Tensor, " m"],
        contributions: Float[Tensor, " m"],
        touched: Bool[Tensor, "r m"],
        pixels: Float[Tensor, "r 2"],
    ) -> None:
        """Add what some rays, of these pixels, saw of some splats."""
        self.contributions[rows] += contributions
        places, inside = pixels[:, None], touched[:, :, None]
        lowest = torch.where(inside, places, torch.inf).amin(0)
        highest = torch.where(inside, places, -torch.inf).amax(0)
        self.lowest[rows] = torch.minimum(self.lowest[rows], lowest)
        self.highest[rows] = torch.maximum(self.highest[rows], highest)

    def record(self, statistics: RenderStatistics, camera: int) -> None:
        """Write the statistics of a camera."""
        sides = (self.highest - self.lowest + 1).amax(1)
        visible = sides > 0
        statistics.visible[camera] = visible
        statistics.radii[camera] = torch.where(visible, 0.5 * sides, 0.0)
        if statistics.contribution is not None:
            statistics.contribution[camera] = self.contributions


@dataclass(frozen=True)
class _Scene:
    """All that one camera has before it."""

    gaussians: Gaussians
    channels: Float[Tensor, "m d"]
    reaches: Float[Tensor, " m"]
    """Largest distance of an affected ray, in scene units; infinite without cut-offs."""


class RayRasterizer(Rasterizer):
    """Renders in float32 and float64 on any torch device, slowly: what splatting approximates.

    ``statistics.radii`` are those of the pixels that a splat reaches, and no outline's.
    """

    def __init__(
        self, mode: Mode | None = None, matched: bool = True, chunk_mb: float = 64.0
    ) -> None:
        """Choose what is rendered.

        Args:
            mode: peaks in the order of splatting when ``None``.
            matched: whether Gaussians grow by a pixel's footprint, as splatting dilates them.
            chunk_mb: working memory, in megabytes; more where one ray with the Gaussians that may
                reach its tile takes more.
        """
        self.mode = mode or Peak()
        self.matched = matched
        self.chunk_mb = chunk_mb
        self.evaluations = 0
        """Evaluations of Gaussians at rays or samples in the latest call of ``render``."""

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything but what needs a projection; never taken unless it is asked for."""
        devices = {"cpu"} | ({"cuda"} if torch.cuda.is_available() else set())
        return Capabilities(
            devices=frozenset(devices),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature) - LACKING,
            determinism=Determinism.BITWISE,
            rule="ray casting",
            preference=-1,
            details={"torch": torch.__version__},
        )

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        _check(cameras, settings)
        self.evaluations = 0
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        images = [
            self._image(splats, cameras.select(slice(i, i + 1)), settings, statistics, i)
            for i in range(len(cameras))
        ]
        channels, depth, weights, left = (torch.stack(parts) for parts in zip(*images, strict=True))
        color, extra = channels.tensor_split([splats.channels], dim=3)
        if settings.background is not None:
            color = color + left * settings.background
        if settings.depth is Depth.EXPECTED:
            depth = depth / weights.clamp(min=settings.profile.depth_epsilon)
        return RenderOutput(
            color=color,
            alpha=1 - left,
            statistics=statistics,
            depth=None if settings.depth is Depth.NONE else depth,
            extra=None if splats.extra is None else extra,
        )

    def _image(
        self,
        splats: Splats,
        camera: Cameras,
        settings: RenderSettings,
        statistics: RenderStatistics,
        index: int,
    ) -> Part:
        """Images of one camera."""
        gaussians = place(splats, camera, settings, self.matched)
        channels = view_colors(splats, camera, gaussians.rows)
        if splats.extra is not None:
            extra = splats.extra.index_select(0, gaussians.rows)
            channels = torch.cat([channels, extra], dim=1)
        scene = _Scene(gaussians, channels, _reaches(gaussians, settings))
        rays, tally = rays_of(camera), Tally.empty(splats.means)
        if settings.contribution_weights is not None:
            rays = replace(rays, weights=settings.contribution_weights[index].reshape(-1, 1))
        parts: list[Part] = []
        places: list[Tensor] = []
        for number, tile in enumerate(tiles(camera, splats.means.device)):
            parts += self._tile(scene, rays.select(tile), number, settings, tally)
            places.append(tile)
        tally.record(statistics, index)
        order = torch.cat(places).argsort()
        columns = (torch.cat(column).index_select(0, order) for column in zip(*parts, strict=True))
        channels, depth, weights, left = (
            column.view(camera.height, camera.width, -1) for column in columns
        )
        return channels, depth, weights, left

    def _tile(
        self, scene: _Scene, rays: Rays, number: int, settings: RenderSettings, tally: Tally
    ) -> list[Part]:
        """Blend the rays of a tile, some at a time."""
        with torch.no_grad():
            near = within_reach(scene.gaussians, rays, scene.reaches).nonzero()[:, 0]
        gaussians, channels = scene.gaussians.select(near), scene.channels.index_select(0, near)
        offsets = self.mode.offsets(len(rays.pixels), number).to(rays.pixels)
        each = max(1, len(near) * self.mode.pairs())
        self.evaluations += each * len(rays.pixels) if len(near) else 0
        pairs = self.chunk_mb * 2**20 / (LIVE_TENSORS * channels.element_size())
        everyone = torch.arange(len(rays.pixels), device=near.device)
        parts = []
        for rows in everyone.split(max(1, int(pairs / each))):
            some = rays.select(rows)
            *part, contributions, touched = self._blend(
                some, offsets[rows], gaussians, channels, settings
            )
            tally.add(gaussians.rows, contributions.detach(), touched, some.pixels)
            parts.append((part[0], part[1], part[2], part[3]))
        return parts

    def _blend(
        self,
        rays: Rays,
        offsets: Float[Tensor, "r s"],
        gaussians: Gaussians,
        channels: Float[Tensor, "m d"],
        settings: RenderSettings,
    ) -> tuple[Tensor, ...]:
        """Blend a chunk without keeping the graph."""

        def blend(
            origins: Tensor,
            directions: Tensor,
            centres: Tensor,
            axes: Tensor,
            opacities: Tensor,
            channels: Tensor,
        ) -> tuple[Tensor, ...]:
            blended = self.mode.blend(
                replace(rays, origins=origins, directions=directions),
                offsets,
                replace(gaussians, centres=centres, axes=axes, opacities=opacities),
                channels,
                settings.profile,
            )
            return (
                *(blended.channels, blended.depths, blended.weights, blended.left),
                *(blended.contributions, blended.touched),
            )

        shapes = (gaussians.centres, gaussians.axes, gaussians.opacities)
        return recomputed(blend, rays.origins, rays.directions, *shapes, channels)


def _check(cameras: Cameras, settings: RenderSettings) -> None:
    lacking = sorted(feature.value for feature in settings.needs().features & LACKING)
    if lacking:
        raise ValueError(
            f"settings: the ray rasterizer has no {' and no '.join(lacking)}, because it projects "
            "nothing; use the reference rasterizer"
        )


def _reaches(gaussians: Gaussians, settings: RenderSettings) -> Float[Tensor, " m"]:
    """Bound of the distance at which o exp(-D^2 / 2) falls to ``alpha_min``; in scene units."""
    if settings.profile.alpha_min <= 0:
        return torch.full_like(gaussians.extents, torch.inf)
    ratio = gaussians.opacities.detach() / settings.profile.alpha_min
    return (2 * ratio.log().clamp(min=0)).sqrt() * gaussians.extents
