"""Kernel arguments: one call of ``render`` in the terms of the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX, QUATERNION_MIN_NORM, NumericsProfile
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.render_arguments import (
    CAMERA_MODELS,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
    SplatArrays,
)

DEPTH_CHANNELS = {Depth.NONE: 0, Depth.ACCUMULATED: 1, Depth.EXPECTED: 2}
"""Channels rendered for depth: depth itself, and the sum of weights, of which 1 - transmittance has
no digits where it is small."""

DTYPES = (torch.float32, torch.float64)


@dataclass(frozen=True)
class PairLimit:
    """Most tile intersections (pairs of a splat and a tile) that an image may have."""

    megabytes: float
    """Memory that all of them may take."""
    bytes: int
    """Memory that one of them takes, unsorted and sorted and in the backward pass."""
    max_pairs: int
    """Most that the kernels can number."""

    @property
    def count(self) -> int:
        """The limit as a number of pairs."""
        return int(min(self.megabytes * 2**20 / self.bytes, self.max_pairs))

    def refuse(self, pairs: int) -> ConfigError:
        """The error for an image with this many pairs."""
        size = f"{pairs * self.bytes} bytes for {pairs} pairs of a splat and a tile"
        advice = "Render a smaller image, keep splats from growing this large, or raise the limit."
        if pairs > self.max_pairs:
            advice = f"No more than {self.max_pairs} pairs can be numbered: render a smaller image."
        return ConfigError(
            f"this image needs {size} that it reaches; rasterizer.pairs_mb={self.megabytes:g} "
            "does not allow that.",
            advice,
        )


@dataclass(frozen=True)
class RenderCall:
    """One call of ``render``: the arguments that its images share."""

    cameras: Cameras
    background: Float[Tensor, " d"]
    """Background of every rendered channel; zeros for extra channels and depth."""
    settings: KernelSettings
    statistics: RenderStatistics
    pixel_weights: Float[Tensor, "c h w"] | None
    """Weights of pixels in contributions; ``None`` for ones."""
    limit: PairLimit

    def inputs(self, splats: SplatArrays, index: int) -> KernelInputs:
        """The inputs of the image of camera ``index``."""
        return KernelInputs(
            splats=splats,
            world_to_camera=self.cameras.world_to_camera[index].contiguous(),
            intrinsics=self.cameras.intrinsics[index].contiguous(),
            background=self.background,
            pixel_weights=row_of(self.pixel_weights, index),
        )

    def outputs(self, image: Tensor, alpha: Tensor, index: int) -> KernelOutputs:
        """The outputs of camera ``index``: its rows of images, alphas and statistics."""
        return KernelOutputs(
            image=image[index],
            alpha=alpha[index],
            visible=self.statistics.visible[index],
            radii=self.statistics.radii[index],
            contribution=row_of(self.statistics.contribution, index),
        )


def row_of(tensor: Tensor | None, index: int) -> Tensor | None:
    """One row of a tensor that may be absent."""
    return None if tensor is None else tensor[index]


def rendered_channels(splats: Splats, settings: RenderSettings) -> int:
    """Number of rendered channels: colour, extra, and those of depth."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    return splats.channels + extras + DEPTH_CHANNELS[settings.depth]


def render_call(
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
    statistics: RenderStatistics,
    limit: PairLimit,
    differentiated: bool,
) -> RenderCall:
    """Put a call of ``render`` into the terms of the kernels.

    Raises:
        ValueError: the splats are neither float32 nor float64.
    """
    if splats.means.dtype not in DTYPES:
        raise ValueError(f"splats.means: expected float32 or float64, found {splats.means.dtype}")
    weights = settings.contribution_weights
    return RenderCall(
        cameras=cameras,
        background=_background(splats, settings),
        settings=_kernel_settings(splats, cameras, settings, limit, differentiated),
        statistics=statistics,
        pixel_weights=None if weights is None else weights.detach()[..., 0].contiguous(),
        limit=limit,
    )


def _background(splats: Splats, settings: RenderSettings) -> Float[Tensor, " d"]:
    """The background of every rendered channel."""
    channels, given = rendered_channels(splats, settings), settings.background
    constant = given is not None and not given.requires_grad
    if given is not None and constant and len(given) == channels:
        return given.to(splats.means).contiguous()
    background = splats.means.new_zeros(channels)
    if given is not None and constant:
        background[: splats.channels] = given
    return background


def active_degree(colors: Sh | Tensor) -> int:
    """The active degree, as far as there are coefficients of it; -1 for plain channels."""
    if not isinstance(colors, Sh):
        return -1
    if colors.offsets is not None:  # The widest row is not known without waiting for a GPU.
        return colors.degree if colors.rest is not None and len(colors.rest) else 0
    return min(colors.degree, degree_of(colors.width))


def _kernel_settings(
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
    limit: PairLimit,
    differentiated: bool,
) -> KernelSettings:
    profile = settings.profile
    cut_offs = _alpha_cut_offs(profile, splats.means.dtype)
    return KernelSettings(
        width=cameras.width,
        height=cameras.height,
        camera_model=CAMERA_MODELS[cameras.model.name.lower()],
        sh_degree=active_degree(splats.colors),
        depth_channels=DEPTH_CHANNELS[settings.depth],
        near=max(settings.near, DEPTH_MIN),
        far=settings.far,
        antialias=settings.antialias,
        dilation=profile.dilation,
        compensation_min=profile.compensation_min,
        jacobian_margin=profile.jacobian_margin,
        alpha_min=profile.alpha_min,
        level_min=cut_offs.level_min,
        alpha_cap=cut_offs.alpha_cap,
        alpha_limit=cut_offs.alpha_limit,
        transmittance_min=profile.transmittance_min,
        length_max=LENGTH_MAX,
        quaternion_min_norm=QUATERNION_MIN_NORM,
        differentiated=differentiated,
        max_pairs=limit.count,
    )


@dataclass(frozen=True)
class _AlphaCutOffs:
    """The cut-offs of alpha as ``KernelSettings`` has them."""

    level_min: float
    alpha_cap: float
    alpha_limit: float


@lru_cache(maxsize=16)
def _alpha_cut_offs(profile: NumericsProfile, dtype: torch.dtype) -> _AlphaCutOffs:
    """The cut-offs of alpha as bounds that are exact in ``dtype``."""
    least, most = torch.tensor([profile.alpha_min, profile.alpha_max], dtype=dtype)
    if profile.alpha_min > 0:
        # Alpha is compared by its logarithm, one rounding of which may not hide a splat.
        level = torch.tensor(math.log2(least.item()), dtype=dtype)
        level_min = level.nextafter(level.new_tensor(-math.inf)).item()
    else:
        level_min = -1e30
    if profile.alpha_max >= 1:  # Transmittance stays one rounding above 0, as in the reference.
        return _AlphaCutOffs(level_min, 1.0 - torch.finfo(dtype).eps, 2.0)
    # A clamped alpha must differ from one that just reaches the clamp, which has its gradient.
    above = most.nextafter(most.new_tensor(2.0)).item()
    return _AlphaCutOffs(level_min, above, most.item())
