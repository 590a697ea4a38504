"""Color: what each splat shows to one camera."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.cameras import Cameras
from gsfw.core.maths.spherical_harmonics import degree_of, sh_basis
from gsfw.core.splats import Sh, Splats


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
