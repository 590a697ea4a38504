"""Rasterizer my-part: plain torch, row by row, differentiated by autograd.

It renders pinhole cameras on any device: colours and extra channels, with gradients of the splats
and the statistic of the screen gradient. It does not antialias, and has no depth images, covariance
form, pose gradients or contributions. ``capabilities`` says so: gsfw refuses a run that needs more.
Equations are those of Kerbl et al. 2023, constants those of ``settings.profile``.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from gsfw.api import (
    CameraModel,
    Cameras,
    Capabilities,
    Feature,
    NumericsProfile,
    Rasterizer,
    RasterizerConfig,
    RenderOutput,
    RenderSettings,
    RenderStatistics,
    Sh,
    Splats,
    rotation_matrices,
    sh_basis,
)
from torch import Tensor
from torch.nn.functional import normalize

FEATURES = frozenset({Feature.GRADIENT, Feature.SH, Feature.EXTRA, Feature.SCREEN_GRADIENT})
LONGEST = 1e9
"""Largest standard deviation, in scene units and in pixels: its fourth power fits float32."""


@dataclass
class MyPartConfig(RasterizerConfig):
    """Settings of rasterizer my-part: none yet."""

    def capabilities(self) -> Capabilities:
        """Abilities on this machine."""
        return MyPart.capabilities()

    def build(self, device: torch.device) -> Rasterizer:
        """Build the rasterizer, which renders wherever its inputs are."""
        return MyPart()


class MyPart(Rasterizer):
    """Projects all splats, then blends those that reach a row of pixels, from front to back."""

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Abilities on this machine; rasterizer=auto prefers all that are built in."""
        pinhole = frozenset({CameraModel.PINHOLE})
        return Capabilities(frozenset({"cpu", "cuda"}), pinhole, FEATURES, preference=-1)

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        views = range(len(cameras))
        images = torch.stack([_view(splats, cameras, settings, statistics, i) for i in views])
        color, extra, alpha = images.tensor_split((splats.channels, -1), dim=3)
        if settings.background is not None:
            color = color + (1 - alpha) * settings.background
        return RenderOutput(color, alpha, statistics, extra=None if splats.extra is None else extra)


def _view(
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
    statistics: RenderStatistics,
    i: int,
) -> Tensor:
    """The image of camera ``i``, [h, w, d]: colours, extra channels, alpha; over zeros."""
    depths, centers, ellipses = _project(splats, cameras, settings, i)
    size = centers.new_tensor([cameras.width, cameras.height])
    reach = _reach(splats.opacities, ellipses, settings.profile)
    inside = (centers + reach > 0) & (centers - reach < size)
    shown = (depths >= settings.near) & (depths <= settings.far) & inside.all(dim=1)
    # Without cut-offs splats have no border, and count as large as the image.
    radii = torch.where(reach.isinf(), 0.5 * size, reach).amax(dim=1)
    statistics.visible[i], statistics.radii[i] = shown, torch.where(shown, radii, 0.0)
    if statistics.screen_gradient is not None and centers.requires_grad:
        _record(statistics.screen_gradient[i], centers, size)
    opaque = splats.opacities.new_ones(len(splats), 1)
    extra = [] if splats.extra is None else [splats.extra]
    channels = torch.cat([_colors(splats, cameras.centers[i]), *extra, opaque], dim=1)
    order = depths.argsort(stable=True)
    x = torch.arange(cameras.width, device=size.device).to(size) + 0.5
    rows = []
    for y in (row + 0.5 for row in range(cameras.height)):
        near = order[(shown & ((centers[:, 1] - y).abs() <= reach[:, 1]))[order]]
        pixels = torch.stack([x, torch.full_like(x, y)], dim=1)
        shape = centers[near], ellipses[near], splats.opacities[near]
        rows.append(_blend(pixels, *shape, channels[near], settings.profile))
    return torch.stack(rows)


def _project(
    splats: Splats, cameras: Cameras, settings: RenderSettings, i: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Depths [n], centres [n, 2] in pixels, and ellipses [n, 4].

    An ellipse is a covariance in pixels squared: xx, xy, yy, and its determinant, which is made of
    the axes since the difference of products loses the digits of needles.
    """
    assert splats.quats is not None  # By ``FEATURES``: no covariance form.
    assert splats.scales is not None
    pose, intrinsics = cameras.world_to_camera[i], cameras.intrinsics[i]
    points = splats.means @ pose[:3, :3].T + pose[:3, 3]
    depths = points[:, 2]
    safe = torch.where(depths >= settings.near, depths, 1.0)[:, None]
    slopes, focal, middle = points[:, :2] / safe, intrinsics.diagonal()[:2], intrinsics[:2, 2]
    size = middle.new_tensor([cameras.width, cameras.height])
    margin = 0.5 * settings.profile.jacobian_margin * size
    # Far outside of the image the linear approximation explodes.
    limited = slopes.clamp(-(middle + margin) / focal, (size - middle + margin) / focal)
    identity = torch.eye(2, dtype=points.dtype, device=points.device)
    parts = [identity.expand(len(points), 2, 2), -limited[:, :, None]]
    jacobian = (focal / safe)[:, :, None] * torch.cat(parts, dim=2)
    scales = splats.scales.clamp(max=LONGEST)[:, None]
    axes = jacobian @ pose[:3, :3] @ (rotation_matrices(splats.quats) * scales)
    first, second = axes.clamp(-LONGEST, LONGEST).unbind(1)
    xx, xy, yy = (first * first).sum(1), (first * second).sum(1), (second * second).sum(1)
    spread = settings.profile.dilation
    determinants = torch.linalg.cross(first, second).square().sum(1) + spread * (xx + yy + spread)
    ellipses = torch.stack([xx + spread, xy, yy + spread, determinants], dim=1)
    return depths, slopes * focal + middle, ellipses


@torch.no_grad()
def _reach(opacities: Tensor, ellipses: Tensor, profile: NumericsProfile) -> Tensor:
    """Half sides of the boxes in which splats are opaque enough, [n, 2]; below 0 for nowhere."""
    least = opacities.new_tensor(profile.alpha_min)
    squares = 2 * (opacities.clamp_min(1e-30) / least).log()
    sides = squares.clamp_min(0)[:, None] * ellipses[:, 0:3:2]
    return torch.where(squares[:, None] < 0, -1e30, sides.sqrt())


def _record(statistic: Tensor, centers: Tensor, size: Tensor) -> None:
    """Let the backward pass write the length of each centre's gradient, in NDC."""

    def hook(gradient: Tensor) -> None:
        statistic.copy_((gradient * size / 2).norm(dim=1))

    centers.register_hook(hook)


def _colors(splats: Splats, center: Tensor) -> Tensor:
    """Colours [n, d] of the splats, seen from a camera's centre."""
    if not isinstance(splats.colors, Sh):
        return splats.colors
    coefficients = splats.colors.dense()
    basis = sh_basis(splats.colors.degree, normalize(splats.means - center, dim=1))
    values = (basis[:, : coefficients.shape[1], None] * coefficients).sum(dim=1)
    return (0.5 + values).clamp_min(0)


def _blend(
    pixels: Tensor,
    centers: Tensor,
    ellipses: Tensor,
    opacities: Tensor,
    channels: Tensor,
    profile: NumericsProfile,
) -> Tensor:
    """Blend splats, sorted from front to back, at pixels [p, 2] into [p, d]."""
    x, y = (pixels[:, None] - centers).unbind(2)
    xx, xy, _, determinants = ellipses.unbind(1)
    # Independent and of variance 1: along x, and what y has besides.
    u, v = x * xx.rsqrt(), (y - x * (xy / xx)) * (xx / determinants).sqrt()
    alphas = (opacities * (-0.5 * (u * u + v * v)).exp()).clamp_max(profile.alpha_max)
    alphas = torch.where(alphas >= profile.alpha_min, alphas, 0.0)
    left = torch.cumprod(1 - alphas, dim=1)
    ahead = torch.cat([torch.ones_like(left[:, :1]), left[:, :-1]], dim=1)
    weights = alphas * ahead
    if profile.transmittance_min > 0:  # A pixel ends before the splat that would hide the rest.
        weights = torch.where(left > profile.transmittance_min, weights, 0.0)
    return weights @ channels
