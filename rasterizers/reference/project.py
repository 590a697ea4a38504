"""Project: from splats to ellipses in one camera's image.

Kerbl et al. 2023, section 4, equations 5 and 6; the compensation is Mip-Splatting's 2D filter (Yu
et al. 2024, equation 9). The determinant of a projected covariance P P^T is summed as |p1 x p2|^2
(Lagrange's identity), where the original's a c - b^2 loses all digits for needles.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.cameras import Cameras
from gsfw.core.maths.lens import project_points
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.spherical_harmonics import degree_of, sh_basis
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX, NumericsProfile
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats


@dataclass(frozen=True)
class Ellipses:
    """``m`` projected Gaussians, in pixels."""

    means: Float[Tensor, "m 2"]
    depths: Float[Tensor, " m"]
    """Along the viewing axis, in scene units."""
    covariances: Float[Tensor, "m 3"]
    """xx, xy, yy, dilated."""
    determinants: Float[Tensor, " m"]
    """Determinants of the dilated covariances."""
    opacities: Float[Tensor, " m"]
    """Compensated for the dilation where antialiasing is on."""


def project(
    splats: Splats, camera: Cameras, settings: RenderSettings, rows: Int[Tensor, " m"] | None = None
) -> Ellipses:
    """Project the splats ``rows`` (all when ``None``), differentiably.

    Rows that ``visible_extents`` refuses may hold anything, NaN included.
    """

    def pick(tensor: Tensor) -> Tensor:
        return tensor if rows is None else tensor.index_select(0, rows)

    rotation, translation = camera.world_to_camera[0, :3, :3], camera.world_to_camera[0, :3, 3]
    points = pick(splats.means) @ rotation.T + translation
    profile = settings.profile
    means, jacobian = project_points(points, camera, profile.jacobian_margin)
    image_from_world = jacobian @ rotation
    if splats.covariances is None:
        assert splats.quats is not None
        assert splats.scales is not None
        axes = (
            rotation_matrices(pick(splats.quats))
            * pick(splats.scales).clamp(max=LENGTH_MAX)[:, None]
        )
        plain, determinants = _from_axes(torch.bmm(image_from_world, axes))
    else:
        plain, determinants = _from_covariances(pick(splats.covariances), image_from_world)
    xx, xy, yy = plain.unbind(1)
    spread = profile.dilation
    dilated = determinants + spread * (xx + yy) + spread * spread
    opacities = pick(splats.opacities)
    if settings.antialias:
        kept = (determinants / dilated).clamp(min=profile.compensation_min**2)
        opacities = opacities * kept.sqrt()
    covariances = torch.stack([xx + spread, xy, yy + spread], dim=1)
    return Ellipses(means, points[:, 2], covariances, dilated, opacities)


def _from_axes(
    axes: Float[Tensor, "m 2 3"],
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """P P^T as xx, xy, yy, and its determinant."""
    first, second = axes.clamp(-LENGTH_MAX, LENGTH_MAX).unbind(1)
    products = [first * first, first * second, second * second]
    normals = torch.linalg.cross(first, second)
    return torch.stack(products, dim=1).sum(2), normals.square().sum(1)


def _from_covariances(
    covariances: Float[Tensor, "m 3 3"], image_from_world: Float[Tensor, "m 2 3"]
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """T Sigma T^T as xx, xy, yy, and its determinant; what rounding makes negative counts as 0."""
    projected = image_from_world @ covariances @ image_from_world.transpose(1, 2)
    most = LENGTH_MAX * LENGTH_MAX
    xx, yy = projected.diagonal(dim1=1, dim2=2).clamp(0, most).unbind(1)
    xy = (0.5 * (projected[:, 0, 1] + projected[:, 1, 0])).clamp(-most, most)
    return torch.stack([xx, xy, yy], dim=1), (xx * yy - xy * xy).clamp(min=0)


def visible_extents(
    ellipses: Ellipses, camera: Cameras, settings: RenderSettings
) -> tuple[Bool[Tensor, " m"], Float[Tensor, "m 2"]]:
    """Ellipses that can reach a pixel, and half the sides of their exact bounding boxes.

    The box ends where opacity * exp(-q) falls to ``alpha_min``; with that set to 0 every splat in
    front reaches the whole image.
    """
    size = ellipses.means.new_tensor([camera.width, camera.height])
    depths = ellipses.depths
    visible = (depths >= max(settings.near, DEPTH_MIN)) & (depths <= settings.far)
    # Comparisons are written so that NaN and infinity fail them.
    visible &= (ellipses.determinants > 0) & (ellipses.determinants < torch.inf)
    visible &= (ellipses.means.abs() <= LENGTH_MAX).all(1)
    # How fast the Jacobian changes with depth must fit the dtype too, or its gradient is NaN.
    visible &= camera.intrinsics[0].diagonal().amax() / depths.square() < torch.inf
    if settings.profile.alpha_min > 0:
        extents = (reach(ellipses, settings.profile)[:, None] * ellipses.covariances[:, ::2]).sqrt()
        visible &= ellipses.opacities >= settings.profile.alpha_min
        inside = (ellipses.means + extents > 0) & (ellipses.means - extents < size)
        visible &= inside.all(1)
    else:
        extents = (0.5 * size).expand(len(depths), 2)
    return visible, extents


def reach(ellipses: Ellipses, profile: NumericsProfile) -> Float[Tensor, " m"]:
    """2 q where the ellipses end: 2 ln(opacity / alpha_min); 0 for those that are fainter."""
    return 2 * (ellipses.opacities / profile.alpha_min).log().clamp(min=0)


def view_colors(splats: Splats, camera: Cameras, rows: Int[Tensor, " m"]) -> Float[Tensor, "m d"]:
    """The colours of some splats as ``camera`` sees them."""
    if not isinstance(splats.colors, Sh):
        return splats.colors.index_select(0, rows)
    coefficients = splats.colors.dense()
    count = coefficients.shape[1]
    degree = degree_of(count)
    # Flat rows, because torch gathers and scatters rows faster than blocks.
    seen = coefficients.reshape(len(splats), 3 * count).index_select(0, rows).view(-1, count, 3)
    directions = normalize(splats.means.index_select(0, rows) - camera.centers, dim=1)
    basis = sh_basis(degree, directions)
    return (torch.bmm(basis[:, None], seen)[:, 0] + 0.5).clamp(min=0)
