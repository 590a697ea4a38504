"""Flat splats: splats as Gaussians in the pixels of an image, drawn by an orthographic camera.

A flat splat lies at its depth, and an orthographic camera draws it as the first camera draws the
splat (Zhao et al. 2024, Grendel-GS, section 3, exchange projected Gaussians too). The projection is
that of the reference rasterizer (Kerbl et al. 2023, equations 5 and 6), in plain torch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.lens import project_points
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.spherical_harmonics import degree_of, sh_basis
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats

SHAPE = 7
"""Values of a flat splat besides its channels: x, y, depth, xx, xy, yy, opacity."""
MARGIN = 1.0
"""Pixels by which a splat may reach farther than computed here: rounding differs in kernels."""


@dataclass(frozen=True)
class FlatSplats:
    """Splats in the pixels of one image, that may reach a pixel of it."""

    rows: Int[Tensor, " m"]
    """The places of these among the splats."""
    values: Float[Tensor, "m k"]
    """x, y, depth, xx, xy, yy, opacity, colours and extra channels; attached to the graph."""
    top: Float[Tensor, " m"]
    """The first row of pixels that each may reach."""
    bottom: Float[Tensor, " m"]
    """The end of the rows of pixels that it may reach."""

    def reaching(self, band: range) -> Int[Tensor, " r"]:
        """The places, among these, of those that may reach a band of the image."""
        return ((self.top < band.stop) & (self.bottom > band.start)).nonzero()[:, 0]


def project(splats: Splats, camera: Cameras, settings: RenderSettings) -> FlatSplats:
    """Project splats into the image of one camera, differentiably."""
    with torch.no_grad():
        values = _shapes(splats, camera, settings)
        visible, reach = _extents(values, camera, settings)
        rows = visible.nonzero()[:, 0]
        top, bottom = (values[:, 1] - reach)[rows], (values[:, 1] + reach)[rows]
    seen = splats.take(rows)
    channels = (
        [_colors(seen, camera)] if seen.extra is None else [_colors(seen, camera), seen.extra]
    )
    values = torch.cat([_shapes(seen, camera, settings), *channels], dim=1)
    return FlatSplats(rows, values, top, bottom)


def _shapes(splats: Splats, camera: Cameras, settings: RenderSettings) -> Float[Tensor, "n 7"]:
    """x, y, depth, xx, xy, yy and opacity of each splat, without dilation."""
    rotation, translation = camera.world_to_camera[0, :3, :3], camera.world_to_camera[0, :3, 3]
    points = splats.means @ rotation.T + translation
    means, jacobian = project_points(points, camera, settings.profile.jacobian_margin)
    image_from_world = jacobian @ rotation
    if splats.covariances is None:
        assert splats.quats is not None
        assert splats.scales is not None
        scales = splats.scales.clamp(max=LENGTH_MAX)
        axes = torch.bmm(image_from_world, rotation_matrices(splats.quats) * scales[:, None])
        first, second = axes.clamp(-LENGTH_MAX, LENGTH_MAX).unbind(1)
        products = [first * first, first * second, second * second]
        xx, xy, yy = torch.stack(products, dim=1).sum(2).unbind(1)
    else:
        projected = image_from_world @ splats.covariances @ image_from_world.transpose(1, 2)
        xx, yy = projected.diagonal(dim1=1, dim2=2).unbind(1)
        xy = 0.5 * (projected[:, 0, 1] + projected[:, 1, 0])
    rest = torch.stack([points[:, 2], xx, xy, yy, splats.opacities], dim=1)
    return torch.cat([means, rest], dim=1)


def _extents(
    shapes: Float[Tensor, "n 7"], camera: Cameras, settings: RenderSettings
) -> tuple[Bool[Tensor, " n"], Float[Tensor, " n"]]:
    """Splats that may reach a pixel, and half the heights of their boxes."""
    profile = settings.profile
    x, y, depth, xx, _, yy, opacity = shapes.unbind(1)
    visible = (depth >= max(settings.near, DEPTH_MIN)) & (depth <= settings.far)
    visible &= (x.abs() <= LENGTH_MAX) & (y.abs() <= LENGTH_MAX)
    if profile.alpha_min <= 0:
        return visible, torch.full_like(y, float(camera.height) + LENGTH_MAX)
    reach = 2 * (opacity / profile.alpha_min).log().clamp(min=0)
    wide, high = ((reach * (spread + profile.dilation)).sqrt() + MARGIN for spread in (xx, yy))
    # Comparisons are written so that NaN and infinity fail them.
    visible &= (opacity >= profile.alpha_min) & (x + wide > 0) & (x - wide < camera.width)
    return visible & (y + high > 0) & (y - high < camera.height), high


def _colors(splats: Splats, camera: Cameras) -> Float[Tensor, "m d"]:
    """The colours of splats as the camera sees them."""
    if not isinstance(splats.colors, Sh):
        return splats.colors
    coefficients = splats.colors.dense()
    directions = normalize(splats.means - camera.centers, dim=1)
    basis = sh_basis(degree_of(coefficients.shape[1]), directions)
    return (torch.bmm(basis[:, None], coefficients)[:, 0] + 0.5).clamp(min=0)


def drawn(values: Float[Tensor, "m k"], channels: int) -> Splats:
    """Flat splats as an orthographic camera draws them.

    Args:
        values: as of ``FlatSplats``.
        channels: of the colours; the others are extra channels.
    """
    zero = torch.zeros_like(values[:, 3])
    xx, xy, yy = values[:, 3:6].unbind(1)
    covariances = torch.stack([xx, xy, zero, xy, yy, zero, zero, zero, zero], dim=1)
    extra = values[:, SHAPE + channels :]
    return Splats(
        means=values[:, :3],
        opacities=values[:, 6],
        colors=values[:, SHAPE : SHAPE + channels],
        covariances=covariances.view(-1, 3, 3),
        extra=extra if extra.shape[1] else None,
    )


def band_camera(camera: Cameras, band: range) -> Cameras:
    """The camera of a band of an image: its pixels are those of the flat splats."""
    pose = torch.eye(4, dtype=camera.world_to_camera.dtype, device=camera.world_to_camera.device)
    lens = pose[:3, :3].clone()
    lens[1, 2] = -float(band.start)
    return replace(
        camera,
        world_to_camera=pose[None],
        intrinsics=lens[None],
        height=len(band),
        model=CameraModel.ORTHOGRAPHIC,
    )
