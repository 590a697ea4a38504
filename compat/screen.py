"""Screen splats: 3D Gaussians projected in torch, and rendered by any rasterizer.

Research code reads and changes what lies between projection and blending: centres in the image
and their gradients. So projection is plain torch (Kerbl et al. 2023, section 4; Zwicker et al.
2001, equation 29). The rasterizer then sees flat Gaussians through an orthographic camera of one
pixel per unit, which projects them onto themselves: its gradient by their centres is, component
by component, the one by the centres in the image.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.api import (
    CameraModel,
    Cameras,
    Feature,
    NumericsProfile,
    RenderOutput,
    RenderSettings,
    Splats,
    Statistic,
    Validation,
    sh_basis,
)
from gsfw.compat.backend import rasterizer_for

Covariances = Float[Tensor, "3 m"]
"""xx, xy, yy of covariances in the image, in pixels squared."""


@dataclass(frozen=True)
class ScreenSplats:
    """``m`` Gaussians in one image, each a row of one call."""

    means: Float[Tensor, "m 2"]
    """Centres in pixels; the first pixel's centre is at (0.5, 0.5)."""
    depths: Float[Tensor, " m"]
    """Along the viewing axis, in scene units; they order the splats."""
    covariances: Covariances
    """Before dilation."""
    opacities: Float[Tensor, " m"]
    channels: Float[Tensor, "m d"]
    visible: Bool[Tensor, " m"]
    """Others are not rendered, and have gradient zero."""


@dataclass(frozen=True)
class ScreenView:
    """Conventions of an image."""

    width: int
    height: int
    background: Float[Tensor, " d"] | None = None
    """One value per channel; ``None`` for zeros."""
    profile: NumericsProfile = field(default_factory=NumericsProfile)
    statistics: frozenset[Statistic] = frozenset()
    validation: Validation = Validation.CHEAP


def render_screen(splats: ScreenSplats, view: ScreenView) -> RenderOutput:
    """Render one image."""
    like, m = splats.means, len(splats.means)
    # Splats at depth 0 are in front of every near plane.
    depths = torch.where(splats.visible, splats.depths, 0.0)
    zeros = like.new_zeros(m)
    xx, xy, yy = splats.covariances
    flat = torch.stack([xx, xy, zeros, xy, yy, zeros, zeros, zeros, zeros], dim=1)
    features = {Feature.ABSGRAD} if Statistic.ABSGRAD in view.statistics else set()
    rasterizer = rasterizer_for(like.device, frozenset(features), view.profile)
    return rasterizer.render(
        Splats(
            means=torch.cat([splats.means, depths[:, None]], dim=1),
            opacities=splats.opacities,
            colors=splats.channels,
            covariances=flat.view(m, 3, 3),
        ),
        Cameras(
            world_to_camera=torch.eye(4, dtype=like.dtype, device=like.device)[None],
            intrinsics=torch.eye(3, dtype=like.dtype, device=like.device)[None],
            width=view.width,
            height=view.height,
            model=CameraModel.ORTHOGRAPHIC,
        ),
        RenderSettings(
            background=view.background,
            near=0.0,
            far=torch.inf,
            statistics=view.statistics,
            profile=view.profile,
            validation=view.validation,
        ),
    )


def project_axes(
    axes: Float[Tensor, "m 3 3"], rotation: Float[Tensor, "3 3"], jacobian: Float[Tensor, "2 3 m"]
) -> Covariances:
    """Project covariances A A^T.

    Args:
        axes: A, rotations times standard deviations, in scene units.
        rotation: from the scene to the camera.
        jacobian: d pixels / d point in the camera.
    """
    # Rows last: torch is many times faster on them than on small matrices.
    turned = (rotation @ axes.permute(1, 2, 0).reshape(3, -1)).view(1, 3, 3, -1)
    first, second = (jacobian[:, :, None] * turned).sum(1)
    return torch.stack([first * first, first * second, second * second]).sum(1)


def project_covariances(
    covariances: Float[Tensor, "m 3 3"],
    rotation: Float[Tensor, "3 3"],
    jacobian: Float[Tensor, "2 3 m"],
) -> Covariances:
    """Project covariances that are given as matrices, in scene units squared."""
    linear = jacobian.permute(2, 0, 1) @ rotation
    flat = linear @ covariances @ linear.transpose(1, 2)
    return torch.stack([flat[:, 0, 0], flat[:, 0, 1], flat[:, 1, 1]])


def compensation(covariances: Covariances, profile: NumericsProfile) -> Float[Tensor, " m"]:
    """The factor sqrt(det before / det after dilation) of antialiased opacities.

    Yu et al. 2024 (Mip-Splatting), equation 9; its floor is the profile's.
    """
    xx, xy, yy = covariances
    before, after = xx * yy - xy * xy, determinant(covariances, profile.dilation)
    return (before / after).clamp_min(profile.compensation_min**2).sqrt()


def dilated(dilation: float) -> NumericsProfile:
    """The usual constants with this dilation, in pixels squared."""
    usual = NumericsProfile()
    if dilation == usual.dilation:
        return usual
    return replace(usual, name=f"{usual.name}, dilation {dilation:g}", dilation=dilation)


def determinant(covariances: Covariances, dilation: float) -> Float[Tensor, " m"]:
    """Determinants of dilated covariances."""
    xx, xy, yy = covariances
    return (xx + dilation) * (yy + dilation) - xy * xy


def view_colors(
    coefficients: Float[Tensor, "m k 3"], degree: int, directions: Float[Tensor, "m 3"]
) -> Float[Tensor, "m 3"]:
    """Colours max(0, 0.5 + sum of coefficient times basis) of the bands up to ``degree``.

    Args:
        coefficients: rows of spherical harmonics; bands above ``degree`` are not read.
        degree: 0 to 4.
        directions: from the camera to the splats, of any length but 0.
    """
    basis = sh_basis(degree, torch.nn.functional.normalize(directions, dim=1))
    used = coefficients[:, : basis.shape[1]]
    return ((basis[:, None] @ used)[:, 0] + 0.5).clamp_min(0.0)
