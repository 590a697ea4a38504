"""The formulas of diff-gaussian-rasterization in plain torch, pixel by pixel and splat by splat.

A reference in float64. Equations: projection and blending after Zwicker et al. 2001, "EWA
Splatting", and Kerbl et al. 2023, "3D Gaussian Splatting"; compensation of the dilation after Yu et
al. 2024, "Mip-Splatting". Constants (0.3, 1.3, 0.1, 0.000025, 1e-7) and the places of pixel centres
are no part of the papers: they are conventions of diff-gaussian-rasterization. Its names of
functions say which of them a function here has to agree with.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.compat.diff_gaussian_rasterization import GaussianRasterizationSettings

C0, C1 = 0.28209479177387814, 0.4886025119029199


@dataclass
class Projected:
    """All splats in the image, in the original's words."""

    centres: Tensor
    """ndc2Pix: the first pixel's centre is 0."""
    conics: Tensor
    """Inverse covariances a, b, c."""
    depths: Tensor
    opacities: Tensor
    colors: Tensor


@dataclass
class Image:
    color: Tensor
    """[3, h, w]"""
    depth: Tensor
    inverse_depth: Tensor


def camera(width: int, height: int, near_x: float = 0.0) -> GaussianRasterizationSettings:
    """A camera at (near_x, 0, -4) that is turned a little, in float64, as Inria's cameras are."""
    turn = torch.tensor(0.2, dtype=torch.float64)
    view = torch.eye(4, dtype=torch.float64)
    view[0, 0], view[0, 2] = turn.cos(), turn.sin()
    view[2, 0], view[2, 2] = -turn.sin(), turn.cos()
    view[:3, 3] = torch.tensor([near_x, 0.0, 4.0])
    tangents = (0.5, 0.5 * height / width)
    near, far = 0.01, 100.0
    clip = torch.zeros(4, 4, dtype=torch.float64)
    clip[0, 0], clip[1, 1] = 1 / tangents[0], 1 / tangents[1]
    clip[2, 2], clip[2, 3], clip[3, 2] = far / (far - near), -far * near / (far - near), 1.0
    return GaussianRasterizationSettings(
        image_height=height,
        image_width=width,
        tanfovx=tangents[0],
        tanfovy=tangents[1],
        bg=torch.tensor([0.2, 0.4, 0.6], dtype=torch.float64),
        scale_modifier=1.0,
        viewmatrix=view.T.contiguous(),
        projmatrix=view.T @ clip.T,
        sh_degree=1,
        campos=view.inverse()[:3, 3],
        prefiltered=False,
        debug=False,
    )


def quaternion_matrix(q: Tensor) -> Tensor:
    """computeCov3D: the quaternion is taken for a unit one."""
    r, x, y, z = q
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - r * z), 2 * (x * z + r * y)],
        [2 * (x * y + r * z), 1 - 2 * (x * x + z * z), 2 * (y * z - r * x)],
        [2 * (x * z - r * y), 2 * (y * z + r * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row) for row in rows])


def covariance_3d(scale: Tensor, rotation: Tensor, modifier: float) -> Tensor:
    """computeCov3D."""
    axes = quaternion_matrix(rotation) * (modifier * scale)
    return axes @ axes.T


def color_of(sh: Tensor, mean: Tensor, settings: GaussianRasterizationSettings) -> Tensor:
    """computeColorFromSH, of degree 1."""
    direction = mean - settings.campos
    x, y, z = direction / direction.norm()
    return (C0 * sh[0] + C1 * (-y * sh[1] + z * sh[2] - x * sh[3]) + 0.5).clamp_min(0)


def covariance_2d(
    mean: Tensor, covariance: Tensor, settings: GaussianRasterizationSettings
) -> tuple[Tensor, Tensor, Tensor]:
    """computeCov2D, before the low-pass filter."""
    s, view = settings, settings.viewmatrix.T
    t = view[:3, :3] @ mean + view[:3, 3]
    tx = torch.clamp(t[0] / t[2], -1.3 * s.tanfovx, 1.3 * s.tanfovx) * t[2]
    ty = torch.clamp(t[1] / t[2], -1.3 * s.tanfovy, 1.3 * s.tanfovy) * t[2]
    fx, fy = s.image_width / (2 * s.tanfovx), s.image_height / (2 * s.tanfovy)
    zero = torch.zeros_like(tx)
    first = torch.stack([fx / t[2], zero, -fx * tx / t[2] ** 2])
    second = torch.stack([zero, fy / t[2], -fy * ty / t[2] ** 2])
    linear = torch.stack([first, second]) @ view[:3, :3]
    flat = linear @ covariance @ linear.T
    return flat[0, 0], flat[0, 1], flat[1, 1]


def compensation(
    before: Tensor, after: Tensor, settings: GaussianRasterizationSettings
) -> Tensor | float:
    """The factor of opacities for determinants before and after dilation."""
    if settings.kernel_size is not None:
        # computeCov2D of mip-splatting, with its epsilons.
        return (before / (after + 1e-6) + 1e-6).sqrt() if before > 1e-6 else 0.0
    return (before / after).clamp_min(0.000025).sqrt() if settings.antialiasing else 1.0


def project(
    means: Tensor,
    opacities: Tensor,
    colors: Tensor,
    covariances: Tensor,
    settings: GaussianRasterizationSettings,
) -> Projected:
    """preprocessCUDA, for splats in front of the camera."""
    s, found = settings, []
    for mean, opacity, covariance in zip(means, opacities[:, 0], covariances, strict=True):
        a, b, c = covariance_2d(mean, covariance, s)
        before = a * c - b * b
        dilation = 0.3 if s.kernel_size is None else s.kernel_size
        a, c = a + dilation, c + dilation
        after = a * c - b * b
        factor = compensation(before, after, s)
        clip = torch.cat([mean, mean.new_ones(1)]) @ s.projmatrix
        device = clip[:2] / (clip[3] + 1e-7)
        size = mean.new_tensor([s.image_width, s.image_height])
        centre = ((device + 1) * size - 1) / 2
        depth = mean @ s.viewmatrix[:3, 2] + s.viewmatrix[3, 2]
        found.append((centre, torch.stack([c, -b, a]) / after, depth, factor * opacity))
    centres, conics, depths, kept = (torch.stack(part) for part in zip(*found, strict=True))
    return Projected(centres, conics, depths, kept, colors)


def radius(conic: Tensor) -> int:
    """my_radius of preprocessCUDA, from the conic of a splat."""
    covariance = torch.tensor([[conic[0], conic[1]], [conic[1], conic[2]]]).inverse()
    a, b, c = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    middle = 0.5 * (a + c)
    spread = (middle**2 - (a * c - b * b)).clamp_min(0.1).sqrt()
    return int((3 * (middle + spread).sqrt()).ceil())


@dataclass
class Layer:
    """One splat at all pixels [h, w]."""

    index: int
    alpha: Tensor
    """0 where it is not blended."""
    ahead: Tensor
    """Transmittance in front of it."""
    gaussian: Tensor
    offsets: Tensor
    """d, [2, h, w]"""


def layers(
    splats: Projected, settings: GaussianRasterizationSettings
) -> tuple[list[Layer], Tensor]:
    """renderCUDA: all splats from front to back, and the transmittance that remains."""
    height, width = settings.image_height, settings.image_width
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([x, y]).to(splats.centres)
    left, going = splats.depths.new_ones(height, width), torch.ones(height, width) > 0
    found = []
    for index in splats.depths.argsort().tolist():
        offsets = splats.centres[index][:, None, None] - pixels
        a, b, c = splats.conics[index]
        power = -0.5 * (a * offsets[0] ** 2 + c * offsets[1] ** 2) - b * offsets[0] * offsets[1]
        gaussian = power.exp()
        alpha = (splats.opacities[index] * gaussian).clamp_max(0.99)
        blended = going & (alpha >= 1 / 255)
        stops = blended & (left * (1 - alpha) < 1e-4)
        going, blended = going & ~stops, blended & ~stops
        alpha = torch.where(blended, alpha, 0.0)
        found.append(Layer(index, alpha, left, gaussian, offsets))
        left = left * (1 - alpha)
    return found, left


def render(splats: Projected, settings: GaussianRasterizationSettings) -> Image:
    """renderCUDA, forward."""
    found, left = layers(splats, settings)
    depths = torch.stack([splats.depths, 1 / splats.depths], dim=1)
    values = torch.cat([splats.colors, depths], dim=1)
    parts = [values[it.index][:, None, None] * it.alpha * it.ahead for it in found]
    image = torch.stack(parts).sum(0)
    return Image(image[:3] + settings.bg[:, None, None] * left, image[3:4], image[4:])


def screen_gradients(
    splats: Projected, settings: GaussianRasterizationSettings, by_pixels: Tensor
) -> tuple[Tensor, Tensor]:
    """renderCUDA, backward: dL_dmean2D [n, 2], and the same with absolute values summed.

    Args:
        splats: detached.
        settings: the view.
        by_pixels: dL_dpixels [3, h, w].
    """
    signed = torch.zeros_like(splats.centres)
    absolute = torch.zeros_like(splats.centres)
    half = splats.centres.new_tensor([0.5 * settings.image_width, 0.5 * settings.image_height])
    found, _ = layers(splats, settings)
    behind = settings.bg[:, None, None]
    for it in reversed(found):
        color = splats.colors[it.index][:, None, None]
        by_alpha = it.ahead * ((color - behind) * by_pixels).sum(0)
        behind = it.alpha * color + (1 - it.alpha) * behind
        by_gaussian = torch.where(it.alpha > 0, splats.opacities[it.index] * by_alpha, 0.0)
        a, b, c = splats.conics[it.index]
        dx, dy = it.gaussian * it.offsets
        slopes = torch.stack([-dx * a - dy * b, -dy * c - dx * b])
        parts = by_gaussian * slopes * half[:, None, None]
        signed[it.index] = parts.sum((1, 2))
        absolute[it.index] = parts.abs().sum((1, 2))
    return signed, absolute
