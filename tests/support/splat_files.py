"""Splats for files of quantised formats, and comparisons with what is read back."""

import torch

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.splats import Sh, Splats

LIMITS = (3.3, 0.98)
"""Magnitudes of the constant and of other SH coefficients."""


def trained_splats(n: int, degree: int, seed: int = 0, extent: float = 10.0) -> Splats:
    """Splats as training makes them: visible, small, of many sizes, denser in the middle."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    constant, others = LIMITS
    colors = (0.3 * normal(n, (degree + 1) ** 2, 3)).clamp(-others, others)
    colors[:, 0] = (colors[:, 0] * 4).clamp(-constant, constant)
    return Splats(
        means=(extent / 4 * normal(n, 3)).clamp(-extent, extent),
        opacities=(2 * normal(n)).sigmoid().clamp_min(0.01),
        colors=Sh(colors.float(), degree),
        quats=normal(n, 4),
        scales=(normal(n, 3) - 4).clamp(-9.9, 2.0).exp() * extent / 10,
    )


def alignment(first: torch.Tensor, second: torch.Tensor) -> float:
    """Least |q . p| of pairs of quaternions of any norm; 1 for equal rotations."""
    unit = torch.nn.functional.normalize
    return float((unit(first.double()) * unit(second.double())).sum(dim=1).abs().min())


def covariances(splats: Splats) -> torch.Tensor:
    """The shapes of splats, whatever the order and the signs of their axes."""
    axes = rotation_matrices(splats.quats.double()) * splats.scales.double()[:, None]
    return axes @ axes.mT


def shape_error(splats: Splats, expected: torch.Tensor) -> float:
    """Largest difference of covariances, relative to their size."""
    error = (covariances(splats) - expected).flatten(1).norm(dim=1)
    return float((error / expected.flatten(1).norm(dim=1)).max())


def largest(first: torch.Tensor, second: torch.Tensor) -> float:
    """Largest difference of two tensors."""
    return float((first.double() - second.double()).abs().max())
