"""Symmetric 3 x 3 matrices: their largest eigenvalues, and their axes.

The eigenvalues of torch on a GPU are cuSOLVER's, which take 256 KB of memory for each matrix and
refuse more than 32,000 of them: rows of a model are not given to them.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Float64
from torch import Tensor


def largest_eigenvalues(matrices: Float[Tensor, "n 3 3"]) -> Float[Tensor, " n"]:
    """The largest eigenvalue of each symmetric matrix, in closed form; the host does not wait.

    With q = trace / 3, 6 p^2 = tr (A - q)^2 and r = det ((A - q) / p) / 2 it is
    q + 2 p cos(acos(r) / 3) (Smith 1961, "Eigenvalues of a symmetric 3 x 3 matrix"). In float64,
    since acos loses half of the digits where the two largest are equal.
    """
    wide = matrices.double()
    largest = wide.abs().amax((1, 2)).clamp_min(torch.finfo(wide.dtype).tiny)
    scaled = wide / largest[:, None, None]
    mean = scaled.diagonal(dim1=1, dim2=2).mean(1)
    apart = scaled - mean[:, None, None] * torch.eye(3, dtype=scaled.dtype, device=scaled.device)
    size = (apart.square().sum((1, 2)) / 6).sqrt()
    unit = apart / size.clamp_min(torch.finfo(wide.dtype).tiny)[:, None, None]
    first, second, third = unit.unbind(1)
    determinants = (torch.linalg.cross(first, second) * third).sum(1)
    angle = (determinants / 2).clamp(-1.0, 1.0).acos() / 3
    return (largest * (mean + 2 * size * angle.cos())).to(matrices)


def principal_axes(
    matrices: Float[Tensor, "n 3 3"],
) -> tuple[Float64[Tensor, "n 3"], Float64[Tensor, "n 3 3"]]:
    """Eigenvalues of symmetric matrices, rising, and the columns of a rotation: eigenvectors.

    The host computes them.
    """
    values, axes = torch.linalg.eigh(matrices.double().cpu())
    # Axes have no sign: inverting the last one turns a reflection into a rotation.
    axes = torch.cat([axes[..., :2], axes[..., 2:] * axes.det().sign()[:, None, None]], dim=-1)
    return values.to(matrices.device), axes.to(matrices.device)
