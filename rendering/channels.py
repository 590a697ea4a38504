"""Channels: the images that can be rendered of a model besides its colours.

Images of values come from the same rasterizer as the colours: a value of each Gaussian is blended
in place of its colour, and divided by the sum of the weights. ``color_maps`` colours them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.plugins.registry import did_you_mean
from gsfw.rendering.gaussian_values import contributions, degrees, speeds
from gsfw.rendering.normals import NAN, surface_normals
from gsfw.rendering.shot import Shot

COUNTED_ALPHA = 1e-3
"""Alpha of every Gaussian while they are counted: 5,000 of them leave 0.7 % of the light, whose
float32 tells them apart."""


@dataclass(frozen=True)
class Channel:
    """One kind of image of a model."""

    name: str
    description: str
    """One phrase, for menus and help."""
    kind: Literal["color", "scalar"]
    """Kind of image: it has colours, or values to be coloured."""
    unit: str = ""
    """Unit of the values, for colour bars; empty for colours and plain fractions."""
    moving: bool = False
    """True if it is there for models that change with time only."""
    needs_image: bool = False
    """True if it compares with a photo, so that it is there for the views of the data only."""
    low: float | None = None
    """The least value of the colour scale; ``None``: that of the values."""
    high: float | None = None
    """The largest value of the colour scale; ``None``: that of the values."""
    colormap: str = "turbo"
    """Name of the colour map that suits the values."""


CHANNELS: Mapping[str, Channel] = MappingProxyType(
    {
        channel.name: channel
        for channel in (
            Channel("color", "the rendered image", "color"),
            Channel("photo", "the image of the data", "color", needs_image=True),
            Channel("depth", "distance along the view axis", "scalar", "scene units"),
            Channel(
                "alpha", "coverage by Gaussians", "scalar", low=0.0, high=1.0, colormap="gray"
            ),
            Channel("normals", "surface directions, from depth", "color"),
            Channel(
                "error", "mean absolute difference to the photo", "scalar", "difference",
                needs_image=True, low=0.0, colormap="magma",
            ),
            Channel(
                "contribution", "pixels that the Gaussians seen here are worth in this view",
                "scalar", "pixels per Gaussian", low=0.0, colormap="viridis",
            ),
            Channel(
                "count", "Gaussians that reach the pixel, hidden ones too", "scalar", "Gaussians",
                low=0.0, colormap="inferno",
            ),
            Channel(
                "sh_degree", "degree of the spherical harmonics", "scalar", "degree",
                low=0.0, colormap="viridis",
            ),
            Channel(
                "motion", "speed of the Gaussians", "scalar",
                "scene units / capture", moving=True, low=0.0, colormap="inferno",
            ),
        )
    }
)  # fmt: skip
"""Every channel, by name, in the order of menus."""


def find_channel(name: str) -> Channel:
    """The channel of a name.

    Raises:
        ConfigError: there is none.
    """
    if name not in CHANNELS:
        raise ConfigError(
            f"there is no channel {name!r}.{did_you_mean(name, CHANNELS)}",
            f"Channels: {', '.join(CHANNELS)}.",
        )
    return CHANNELS[name]


def available_channels(moves: bool, has_images: bool) -> tuple[Channel, ...]:
    """The channels that a model has.

    Args:
        moves: the model changes with time.
        has_images: the views have photos to compare with.
    """
    return tuple(
        channel
        for channel in CHANNELS.values()
        if moves >= channel.moving and has_images >= channel.needs_image
    )


@torch.no_grad()
def render_channels(
    channels: Sequence[Channel], shot: Shot
) -> list[Float[Tensor, "h w 3"] | Float[Tensor, "h w"]]:
    """Render channels of one camera; those that need the same pass share it.

    Args:
        channels: the images to make.
        shot: the model and its view; the settings' depth and statistics are set as channels need.

    Returns:
        For each channel [h, w, 3] in [0, 1] of kind ``color``, or [h, w] values of kind ``scalar``,
        NaN where there is none; on the device of the camera.

    Raises:
        ConfigError: a channel lacks its photo, or its time.
        UnavailableError: the rasterizer cannot render a channel.
    """
    for channel in channels:
        if channel.needs_image and shot.target is None:
            raise ConfigError(
                f"channel {channel.name!r} compares with a photo, and this view has none.",
                "Render it of the views of the data.",
            )
        if channel.moving and shot.time is None:
            raise ConfigError(
                f"channel {channel.name!r} needs a model that changes with time.",
                "Leave this channel out.",
            )
    shared = replace(shot, has_surface=any(channel.name in SURFACE for channel in channels))
    return [_MAKERS[channel.name](shared) for channel in channels]


SURFACE = frozenset({"depth", "normals"})
"""Channels that need the depth image."""


def _color(shot: Shot) -> Tensor:
    return shot.output.color[0].clamp(0, 1)


def _photo(shot: Shot) -> Tensor:
    assert shot.target is not None, "it was checked"
    return shot.target.clamp(0, 1)


def _depth(shot: Shot) -> Tensor:
    return shot.depth


def _alpha(shot: Shot) -> Tensor:
    return shot.output.alpha[0, ..., 0]


def _normals(shot: Shot) -> Tensor:
    """Normals in the camera's axes, as colours: red to the right, green up, blue to the camera."""
    normals = surface_normals(shot.depth, shot.camera)
    shown = 0.5 + 0.5 * normals * normals.new_tensor([1.0, -1.0, -1.0])
    return shown.nan_to_num(0.0).clamp(0, 1)


def _error(shot: Shot) -> Tensor:
    assert shot.target is not None, "it was checked"
    error = (shot.output.color[0].clamp(0, 1) - shot.target.clamp(0, 1)).abs().mean(2)
    return error if shot.valid is None else torch.where(shot.valid[..., 0], error, NAN)


def _contribution(shot: Shot) -> Tensor:
    return shot.mean(contributions(shot.splats, shot.rasterizer, shot.camera, shot.settings))


def _count(shot: Shot) -> Tensor:
    """The number of Gaussians that reach each pixel, by the light that equal ones let through."""
    own = shot.rasterizer.capabilities().profile
    if own:
        raise UnavailableError(
            f"channel 'count' needs a rasterizer that renders with any numerics, and this one has "
            f"only its own ({own}).",
            "Render it with rasterizer=cpu or rasterizer=cuda.",
        )
    profile = replace(
        shot.settings.profile, name="count", alpha_max=COUNTED_ALPHA, transmittance_min=0.0
    )
    settings = replace(shot.settings, profile=profile)
    alpha = shot.blend(torch.ones_like(shot.splats.opacities), settings).alpha[0, ..., 0].double()
    passing = torch.log1p(-torch.tensor(COUNTED_ALPHA, dtype=torch.float64))
    return (torch.log1p(-alpha.clamp(max=1 - 1e-7)) / passing.to(alpha)).round().to(torch.float32)


def _sh_degree(shot: Shot) -> Tensor:
    return shot.mean(degrees(shot.splats))


def _motion(shot: Shot) -> Tensor:
    assert shot.time is not None, "it was checked"
    return shot.mean(speeds(shot.model, shot.splats, shot.time))


_MAKERS: Mapping[str, Callable[[Shot], Tensor]] = {
    "color": _color,
    "photo": _photo,
    "depth": _depth,
    "alpha": _alpha,
    "normals": _normals,
    "error": _error,
    "contribution": _contribution,
    "count": _count,
    "sh_degree": _sh_degree,
    "motion": _motion,
}
