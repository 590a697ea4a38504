"""Request: a call of ``render`` in the terms of ``gsplat.rasterization``."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.spherical_harmonics import degree_of, sh_basis
from gsfw.core.numerics import DEPTH_MIN
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats

MODELS = {
    CameraModel.PINHOLE: "pinhole",
    CameraModel.ORTHOGRAPHIC: "ortho",
    CameraModel.FISHEYE: "fisheye",
}

MODES = {Depth.NONE: "RGB", Depth.ACCUMULATED: "RGB+D", Depth.EXPECTED: "RGB+ED"}
"""With depth, it is rendered as one more channel, the last."""


def arguments_of(splats: Splats, cameras: Cameras, settings: RenderSettings) -> dict[str, Any]:
    """The arguments of ``gsplat.rasterization``, by name.

    Only those are used that gsplat 1.5.3 and 1.6.0 have and mean alike.
    """
    colors, degree = _colors(splats, cameras)
    return {
        "means": splats.means,
        "quats": splats.quats,
        "scales": splats.scales,
        "covars": _symmetric(splats.covariances),
        "opacities": splats.opacities,
        "colors": colors,
        "sh_degree": degree,
        "viewmats": cameras.world_to_camera,
        "Ks": cameras.intrinsics,
        "width": cameras.width,
        "height": cameras.height,
        "camera_model": MODELS[cameras.model],
        "near_plane": max(settings.near, DEPTH_MIN),
        "far_plane": settings.far,
        "eps2d": settings.profile.dilation,
        "rasterize_mode": "antialiased" if settings.antialias else "classic",
        "render_mode": MODES[settings.depth],
        "backgrounds": _backgrounds(splats, cameras, settings),
        "absgrad": Statistic.ABSGRAD in settings.statistics,
        # Packed, the projected centres have a row per visible splat instead of one per splat.
        "packed": False,
    }


def _symmetric(covariances: Tensor | None) -> Tensor | None:
    """The same matrices, whose gradients are then symmetric: gsplat reads the upper triangle."""
    return None if covariances is None else 0.5 * (covariances + covariances.mT)


def rendered_channels(splats: Splats, settings: RenderSettings) -> int:
    """Channels that gsplat is asked to render: colours, extra ones, and depth."""
    extras = 0 if splats.extra is None else splats.extra.shape[1]
    return splats.channels + extras + (settings.depth is not Depth.NONE)


def _colors(splats: Splats, cameras: Cameras) -> tuple[Tensor, int | None]:
    """Colours as gsplat wants them, and the SH degree that it evaluates; ``None`` for channels."""
    colors, extra = splats.colors, splats.extra
    if not isinstance(colors, Sh):
        return (colors if extra is None else torch.cat([colors, extra], dim=1)), None
    coefficients = colors.dense()
    if extra is None:
        return coefficients, degree_of(coefficients.shape[1])
    # Beside spherical harmonics gsplat 1.5 renders no other channels, so they are evaluated here.
    seen = _view_colors(coefficients, splats.means, cameras)
    return torch.cat([seen, extra.expand(len(cameras), *extra.shape)], dim=2), None


def _view_colors(
    coefficients: Float[Tensor, "n k 3"], means: Float[Tensor, "n 3"], cameras: Cameras
) -> Float[Tensor, "c n 3"]:
    """Colours of spherical harmonics from each camera."""
    directions = normalize(means - cameras.centers[:, None], dim=2)
    basis = sh_basis(degree_of(coefficients.shape[1]), directions)
    return (torch.einsum("cnk,nkd->cnd", basis, coefficients) + 0.5).clamp(min=0)


def _backgrounds(
    splats: Splats, cameras: Cameras, settings: RenderSettings
) -> Float[Tensor, "c d"] | None:
    """The background of every camera, with zeros for extra channels; gsplat adds that of depth."""
    background = settings.background
    if background is None:
        return None
    if splats.extra is not None:
        background = torch.cat([background, background.new_zeros(splats.extra.shape[1])])
    return background.expand(len(cameras), len(background))
