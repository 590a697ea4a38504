"""Principal axes: splats given by covariances, as files and most tools have them."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.maths.frame import quaternion_of
from gsfw.core.splats import Splats


@torch.no_grad()
def with_axes(splats: Splats) -> Splats:
    """The same splats by quaternions and scales, largest last; as they are if they have them.

    Eigenvalues are taken in float64; those that rounding made negative count as zero.
    """
    if splats.covariances is None:
        return splats
    variances, axes = torch.linalg.eigh(splats.covariances.double())
    # Axes have no sign: with the last one turned around, a reflection is a rotation.
    axes = torch.cat([axes[..., :2], axes[..., 2:] * axes.det().sign()[:, None, None]], dim=-1)
    return replace(
        splats,
        quats=quaternion_of(axes).to(splats.means),
        scales=variances.clamp_min(0.0).sqrt().to(splats.means),
        covariances=None,
    )
