"""Gaussians: what one camera has before it, in its axes, from front to back."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.ray.camera_rays import Rays
from gsfw.rasterizers.ray.footprint import pixel_steps

FARTHEST = 1e18
"""Gaussians farther off than so many times their size are left out: squares must fit float32."""

SLACK = 1e-5
"""Relative margin of distances: rounding must not move a Gaussian out of a tile's reach."""

PIVOT = 4.0
"""Roundings of a covariance's diagonal: it says nothing of axes whose square is smaller."""


@dataclass(frozen=True)
class Gaussians:
    """``m`` Gaussians; the covariance of each is extent^2 times axes times its transpose."""

    rows: Int[Tensor, " m"]
    """Indices of their splats."""
    centres: Float[Tensor, "m 3"]
    """In camera axes."""
    axes: Float[Tensor, "m 3 k"]
    """Columns in units of ``extents``: three of the splat, and two of the dilation if matched."""
    extents: Float[Tensor, " m"]
    """Root of the sum of the squared axes, so that no deviation is larger; without gradient, which
    none needs: the unit of length cancels."""
    opacities: Float[Tensor, " m"]

    def select(self, rows: Int[Tensor, " s"]) -> Gaussians:
        """Some of them."""
        tensors = (self.rows, self.centres, self.axes, self.extents, self.opacities)
        return Gaussians(*(tensor.index_select(0, rows) for tensor in tensors))


def place(splats: Splats, camera: Cameras, settings: RenderSettings, matched: bool) -> Gaussians:
    """The visible Gaussians, by view depth of the centres, ties by row; differentiable.

    Args:
        splats: all.
        camera: one camera.
        settings: its near and far planes, and its numerics.
        matched: whether Gaussians grow by the dilation that splatting adds; see ``footprint``.
    """
    spread = settings.profile.dilation if matched else 0.0
    with torch.no_grad():
        everyone = torch.arange(len(splats), device=splats.means.device)
        everything = _placed(splats, camera, spread, everyone)
        depths = everything.centres[:, 2]
        rows = _renderable(everything, camera, settings).nonzero()[:, 0]
        rows = rows[depths[rows].argsort(stable=True)]
    return _placed(splats, camera, spread, rows)


def _placed(splats: Splats, camera: Cameras, spread: float, rows: Int[Tensor, " m"]) -> Gaussians:
    rotation, translation = camera.world_to_camera[0, :3, :3], camera.world_to_camera[0, :3, 3]
    centres = splats.means.index_select(0, rows) @ rotation.T + translation
    if splats.covariances is None:
        assert splats.quats is not None
        assert splats.scales is not None
        scales = splats.scales.index_select(0, rows).clamp(max=LENGTH_MAX)
        axes = rotation @ rotation_matrices(splats.quats.index_select(0, rows)) * scales[:, None]
    else:
        axes = rotation @ _root(splats.covariances.index_select(0, rows))
    if spread > 0:
        axes = torch.cat([axes, spread**0.5 * pixel_steps(centres, camera)], dim=2)
    extents = axes.detach().flatten(1).norm(dim=1)
    units = torch.where(extents > 0, extents, 1.0)
    opacities = splats.opacities.index_select(0, rows)
    return Gaussians(rows, centres, axes / units[:, None, None], extents, opacities)


def _root(covariances: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 3 3"]:
    """A triangular root (Cholesky's); axes thinner than rounding leaves them become that thick."""
    full = 0.5 * (covariances + covariances.transpose(1, 2))
    most = full.detach().diagonal(dim1=1, dim2=2).amax(1).clamp(0, LENGTH_MAX**2)
    tiny = torch.finfo(full.dtype).tiny
    unit = full / most.clamp(min=tiny)[:, None, None]
    floor = unit.new_tensor(PIVOT * torch.finfo(full.dtype).eps)
    xx, xy, xz, yy, yz, zz = (unit[:, i, j] for i in range(3) for j in range(i, 3))
    a = torch.maximum(xx, floor).sqrt()
    b, c = xy / a, xz / a
    d = torch.maximum(yy - b * b, floor).sqrt()
    e = (yz - b * c) / d
    f = torch.maximum(zz - c * c - e * e, floor).sqrt()
    zero = torch.zeros_like(a)
    root = torch.stack([a, zero, zero, b, d, zero, c, e, f], dim=1).view(-1, 3, 3)
    return root * most.sqrt()[:, None, None]


def _renderable(
    gaussians: Gaussians, camera: Cameras, settings: RenderSettings
) -> Bool[Tensor, " m"]:
    """In front, opaque enough and of finite size; NaN and infinity fail every comparison."""
    centres, extents = gaussians.centres, gaussians.extents
    depths = centres[:, 2]
    rendered = (depths >= max(settings.near, DEPTH_MIN)) & (depths <= settings.far)
    rendered &= gaussians.opacities >= settings.profile.alpha_min
    rendered &= (extents > 0) & (extents < torch.inf)
    rendered &= centres.abs().amax(1) < FARTHEST * extents
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return rendered
    # Farther to the side, the footprint's derivative does not fit float32.
    return rendered & (centres[:, :2].abs().amax(1) <= LENGTH_MAX * depths)


def within_reach(
    gaussians: Gaussians, rays: Rays, reaches: Float[Tensor, " m"]
) -> Bool[Tensor, " m"]:
    """Gaussians that may come nearer to one of the rays than their reach; none is left out.

    A ray that leaves a tile's middle by the angle b passes a point at the angle a from the middle,
    at distance v, by v sin(a - b) at least, or v sin(a + b) where that is behind.
    """
    middle = len(rays.directions) // 2
    axis, origin = rays.directions[middle], rays.origins[middle]
    spread = _angles(rays.directions, axis).amax()
    apart = (rays.origins - origin).norm(dim=1).amax()
    away = gaussians.centres - origin
    size = away.abs().amax(1).clamp(min=torch.finfo(away.dtype).tiny)
    distances = size * (away / size[:, None]).norm(dim=1)
    angles = _angles(away / size[:, None], axis)
    low = (angles - spread).clamp(min=0).sin()
    high = (angles + spread).clamp(max=torch.pi).sin()
    nearest = distances * torch.minimum(low, high)
    return nearest <= (reaches + apart) * (1 + SLACK) + SLACK * distances


def _angles(vectors: Float[Tensor, "n 3"], axis: Float[Tensor, " 3"]) -> Float[Tensor, " n"]:
    across = torch.linalg.cross(vectors, axis.expand_as(vectors)).norm(dim=1)
    return torch.atan2(across, vectors @ axis)
