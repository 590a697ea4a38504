"""Values of each Gaussian that can be shown in place of its colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from gsfw.core.capabilities import Feature
from gsfw.core.errors import UnavailableError
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.splats import Sh, Splats
from gsfw.core.temporal_metrics.tracks import follow

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from gsfw.core.cameras import Cameras
    from gsfw.core.model import PrimitiveModel
    from gsfw.core.rasterizer import Rasterizer
    from gsfw.core.render_settings import RenderSettings

TIME_STEP = 1 / 256
"""Half of the time over which motion is measured, of the time of the capture: less than one frame
of most captures, and enough for the digits of float32."""


def view_depths(splats: Splats, camera: Cameras) -> Float[Tensor, " n"]:
    """Depth of the centres along the axis of the camera, in scene units."""
    pose = camera.world_to_camera[0].to(splats.means)
    return splats.means @ pose[2, :3] + pose[2, 3]


def contributions(
    splats: Splats, rasterizer: Rasterizer, camera: Cameras, settings: RenderSettings
) -> Float[Tensor, " n"]:
    """Pixels that each Gaussian is worth in the image: its weights, summed over the image.

    Raises:
        UnavailableError: the rasterizer does not measure them.
    """
    if Feature.CONTRIBUTION not in rasterizer.capabilities().features:
        raise UnavailableError(
            "channel 'contribution' needs a rasterizer that measures contributions.",
            "Render it with rasterizer=cpu or rasterizer=cuda.",
        )
    return rasterizer.contributions(splats, camera, settings=settings)[0]


def degrees(splats: Splats) -> Float[Tensor, " n"]:
    """Degree of the spherical harmonics of each Gaussian; 0 where colours are the same all round.

    At most the active degree.
    """
    colors = splats.colors
    if not isinstance(colors, Sh):
        return torch.zeros_like(splats.opacities)
    if colors.offsets is None:
        return torch.full_like(splats.opacities, min(colors.degree, degree_of(colors.width)))
    lengths = colors.offsets.diff().to(splats.opacities)
    return ((lengths + 1).sqrt() - 1).clamp(max=colors.degree)


def speeds(model: PrimitiveModel, splats: Splats, time: Float[Tensor, ""]) -> Float[Tensor, " n"]:
    """Speed of each Gaussian at a time, in scene units in the time of the capture.

    The difference of its places a little later and earlier; from where it is to one of them where
    it is not there at the other; 0 where it is at neither.

    Args:
        model: the model.
        splats: its Gaussians at ``time``.
        time: in [0, 1].
    """
    now = float(time)
    first, last = max(now - TIME_STEP, 0.0), min(now + TIME_STEP, 1.0)
    before, after = follow(model, (first, last)).positions
    here = splats.means
    if splats.rows is not None:
        before, after = before[splats.rows], after[splats.rows]
    found = torch.full_like(here[:, 0], torch.nan)
    for shift, step in (
        (after - before, last - first),
        (after - here, last - now),
        (here - before, now - first),
    ):
        if step > 0:
            speed = shift.norm(dim=1) / step
            found = torch.where(found.isfinite(), found, speed)
    return found.nan_to_num(0.0)
