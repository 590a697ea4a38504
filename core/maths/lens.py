"""Lens: where a camera model puts a point, and how the image moves with it.

The Jacobian is that of EWA splatting (Zwicker et al. 2001, equation 29) for the pinhole; the other
two models follow from differentiating their own mapping.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras

SERIES_BELOW = 1e-2
"""Squared slope under which the fisheye's ratios are summed as series instead of divided."""

SERIES_TERMS = 9
"""Terms of these series; the first one left out is SERIES_BELOW ** 9, below double rounding."""


def project_points(
    points: Float[Tensor, "m 3"], camera: Cameras, margin: float
) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "m 2 3"]]:
    """Project points of positive depth.

    Args:
        points: in camera axes.
        camera: one camera.
        margin: ``NumericsProfile.jacobian_margin``.

    Returns:
        The points in pixels, and d pixels / d point.
    """
    focal = camera.intrinsics[0].diagonal()[:2]
    principal = camera.intrinsics[0, :2, 2]
    if camera.model is CameraModel.ORTHOGRAPHIC:
        zeros = points.new_zeros(2, 1)
        jacobian = torch.cat([focal.diag(), zeros], dim=1)
        return focal * points[:, :2] + principal, jacobian.expand(len(points), 2, 3)
    slopes = points[:, :2] / points[:, 2:]
    if camera.model is CameraModel.FISHEYE:
        unit, jacobian = _equidistant(slopes)
    else:
        size = points.new_tensor([camera.width, camera.height])
        beyond = margin * 0.5 * size / focal
        low, high = -principal / focal - beyond, (size - principal) / focal + beyond
        # Linearised far outside the image, a splat would smear across it.
        unit, jacobian = slopes, _perspective(slopes.clamp(low, high))
    return focal * unit + principal, jacobian * focal[:, None] / points[:, 2, None, None]


def _perspective(slopes: Float[Tensor, "m 2"]) -> Float[Tensor, "m 2 3"]:
    """The derivative of slopes by points, times depth."""
    identity = torch.eye(2, dtype=slopes.dtype, device=slopes.device)
    return torch.cat([identity.expand(len(slopes), 2, 2), -slopes[:, :, None]], dim=2)


def _equidistant(
    slopes: Float[Tensor, "m 2"],
) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "m 2 3"]]:
    """The fisheye r = theta at unit focal length, and its derivative times depth.

    With s the squared slope: theta / tan(theta) = atan(sqrt(s)) / sqrt(s) scales the slopes; that
    ratio's derivative by s, doubled, is (1 / (1 + s) - ratio) / s.
    """
    squared = slopes.square().sum(1)
    near_axis = squared < SERIES_BELOW
    large = torch.where(near_axis, 1.0, squared)
    small = torch.where(near_axis, squared, 0.0)
    ratio_series = torch.zeros_like(small)
    bend_series = torch.zeros_like(small)
    for term in reversed(range(SERIES_TERMS)):
        ratio_series = 1 / (2 * term + 1) - small * ratio_series
        bend_series = -(2 * term + 2) / (2 * term + 3) - small * bend_series
    root = large.sqrt()
    ratio = torch.where(near_axis, ratio_series, root.atan() / root)
    bend = torch.where(near_axis, bend_series, (1 / (1 + large) - root.atan() / root) / large)
    outer = slopes[:, :, None] * slopes[:, None, :]
    identity = torch.eye(2, dtype=slopes.dtype, device=slopes.device)
    across = ratio[:, None, None] * identity + bend[:, None, None] * outer
    along = -slopes / (1 + squared)[:, None]
    return slopes * ratio[:, None], torch.cat([across, along[:, :, None]], dim=2)
