"""Request: what is asked of kernels, in their own terms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX, QUATERNION_MIN_NORM, NumericsProfile
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats

MODELS = {CameraModel.PINHOLE: 0, CameraModel.ORTHOGRAPHIC: 1, CameraModel.FISHEYE: 2}
"""As ``CameraModel`` of kernels/shared/camera.h numbers them."""

DEPTH_CHANNELS = {Depth.NONE: 0, Depth.ACCUMULATED: 1, Depth.EXPECTED: 2}
"""Channels drawn for depth: depth itself, and the sum of weights, of which 1 - transmittance has no
digits where it is small."""

DTYPES = (torch.float32, torch.float64)


@dataclass(frozen=True)
class PairLimit:
    """How many pairs of a splat and a tile a picture may have."""

    megabytes: float
    """Memory they may take."""
    bytes: int
    """Memory that one of them takes: as it is found, as it is sorted, and in the backward pass."""
    most: int
    """Pairs that can be numbered."""

    @property
    def count(self) -> int:
        """The limit as a number of pairs."""
        return int(min(self.megabytes * 2**20 / self.bytes, self.most))


@dataclass(frozen=True)
class Request:
    """One call of ``render``."""

    cameras: Cameras
    background: Tensor
    """[d]: of every channel that is drawn, zeros for those that have none."""
    numbers: dict[str, float | int | bool]
    """Everything that is a plain number, by the name that kernels give it."""
    statistics: RenderStatistics
    pixel_weights: Tensor | None
    """[c, h, w]: of each pixel in contributions; ``None`` for ones."""
    limit: PairLimit

    def refuse(self, pairs: int) -> ConfigError:
        """Why a picture with this many pairs is not drawn."""
        size = f"{pairs * self.limit.bytes} bytes for {pairs} pairs of a splat and a tile"
        advice = "Draw a smaller image, keep splats from growing this large, or raise the limit."
        if pairs > self.limit.most:
            advice = f"No more than {self.limit.most} pairs can be numbered: draw a smaller image."
        return ConfigError(
            f"this picture needs {size} that it reaches; rasterizer.pairs_mb="
            f"{self.limit.megabytes:g} does not allow that.",
            advice,
        )


def drawn_channels(splats: Splats, settings: RenderSettings) -> int:
    """Channels that are painted: colour, extra, and those of depth."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    return splats.channels + extras + DEPTH_CHANNELS[settings.depth]


def request_of(
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
    statistics: RenderStatistics,
    limit: PairLimit,
) -> Request:
    """Put a call of ``render`` into the kernels' terms.

    Raises:
        ValueError: the splats are neither float32 nor float64.
    """
    if splats.means.dtype not in DTYPES:
        raise ValueError(f"splats.means: expected float32 or float64, found {splats.means.dtype}")
    background = splats.means.new_zeros(drawn_channels(splats, settings))
    if settings.background is not None and not settings.background.requires_grad:
        background[: splats.channels] = settings.background
    numbers = _numbers(settings, splats.means.dtype)
    numbers |= {
        "width": cameras.width,
        "height": cameras.height,
        "model": MODELS[cameras.model],
        "sh_degree": _sh_degree(splats.colors),
        "depth_channels": DEPTH_CHANNELS[settings.depth],
        "most_pairs": limit.count,
    }
    weights = settings.contribution_weights
    pixel_weights = None if weights is None else weights.detach()[..., 0].contiguous()
    return Request(cameras, background, numbers, statistics, pixel_weights, limit)


def _sh_degree(colors: Sh | Tensor) -> int:
    """The active degree, as far as there are coefficients of it; -1 for plain channels."""
    if not isinstance(colors, Sh):
        return -1
    if colors.offsets is not None:  # The widest row is not known without waiting for a GPU.
        return colors.degree if colors.rest is not None and len(colors.rest) else 0
    return min(colors.degree, degree_of(colors.width))


def _numbers(settings: RenderSettings, dtype: torch.dtype) -> dict[str, float | int | bool]:
    profile = settings.profile
    return {
        "jacobian_margin": profile.jacobian_margin,
        "dilation": profile.dilation,
        "compensation_min": profile.compensation_min,
        "alpha_min": profile.alpha_min,
        "near": max(settings.near, DEPTH_MIN),
        "far": settings.far,
        "length_max": LENGTH_MAX,
        "quaternion_min_norm": QUATERNION_MIN_NORM,
        "antialias": settings.antialias,
        "transmittance_min": profile.transmittance_min,
        **_alpha_cut_offs(profile, dtype),
    }


@lru_cache(maxsize=16)
def _alpha_cut_offs(profile: NumericsProfile, dtype: torch.dtype) -> dict[str, float]:
    """The cut-offs of alpha as bounds that are exact in ``dtype``."""
    least, most = torch.tensor([profile.alpha_min, profile.alpha_max], dtype=dtype)
    if profile.alpha_min > 0:
        # Alpha is compared by its logarithm, one rounding of which may not hide a splat.
        level = torch.tensor(math.log2(least.item()), dtype=dtype)
        level_min = level.nextafter(level.new_tensor(-math.inf)).item()
    else:
        level_min = -1e30
    if profile.alpha_max >= 1:  # What passes stays one rounding above 0, as in the reference.
        return {
            "level_min": level_min,
            "alpha_cap": 1.0 - torch.finfo(dtype).eps,
            "alpha_limit": 2.0,
        }
    # A clamped alpha must differ from one that just reaches the clamp, which has its gradient.
    above = most.nextafter(most.new_tensor(2.0)).item()
    return {"level_min": level_min, "alpha_cap": above, "alpha_limit": most.item()}
