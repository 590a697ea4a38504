"""Peak: each Gaussian counts once, as much as where its response along the ray is largest.

alpha = min(0.99, o exp(-D^2(t*) / 2)), blended from front to back as Kerbl et al. 2023, equation 3,
with the same cut-offs. The order is that of splatting, by view depth of the means, or that of t* on
each ray (as Moenne-Loccoz et al. 2024), which tells the error of sorting from that of projecting. A
peak behind the camera is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.numerics import NumericsProfile
from gsfw.rasterizers.ray.camera_rays import Rays
from gsfw.rasterizers.ray.gaussians import Gaussians
from gsfw.rasterizers.ray.mode import Blended, Mode
from gsfw.rasterizers.ray.response import respond
from gsfw.rasterizers.reference.tile_buffer import CutOffs

Order = Literal["mean", "ray"]


@dataclass(frozen=True)
class Peak(Mode):
    """Sees Gaussians one after the other."""

    order: Order = "mean"
    """"mean": as splatting sorts, and view depths are those of the means; "ray": by t*, and they
    are those of the peaks."""

    def pairs(self) -> int:
        """One evaluation per ray and Gaussian."""
        return 1

    def offsets(self, rays: int, tile: int) -> Float[Tensor, "r s"]:
        """None: there is nothing random."""
        return torch.empty(rays, 0)

    def blend(
        self,
        rays: Rays,
        offsets: Float[Tensor, "r s"],
        gaussians: Gaussians,
        channels: Float[Tensor, "m d"],
        profile: NumericsProfile,
    ) -> Blended:
        """See Gaussians, given from front to back, with their ``channels``; differentiable."""
        response = respond(rays, gaussians)
        falloff, peaks = response.falloff, response.peaks
        if rays.central:
            falloff = torch.where(peaks > 0, falloff, 0.0)
        cut_offs = CutOffs.of(profile, falloff.dtype)
        alphas = cut_offs.clamp(gaussians.opacities * falloff)
        touched = alphas.detach() > 0
        if self.order == "ray":
            ranks = peaks.detach().argsort(dim=1, stable=True)
            sorted_weights, left = _weights(alphas.gather(1, ranks), cut_offs)
            weights = torch.zeros_like(alphas).scatter(1, ranks, sorted_weights)
            depths = rays.origins[:, 2:] + peaks * rays.directions[:, 2:]
            # The peak of a ray without a hit may be anywhere.
            depths = torch.where(touched, depths, 0.0)
        else:
            weights, left = _weights(alphas, cut_offs)
            depths = gaussians.centres[:, 2].expand_as(weights)
        return Blended(
            channels=weights @ channels,
            depths=(weights * depths).sum(1, keepdim=True),
            weights=weights.sum(1, keepdim=True),
            left=left,
            contributions=rays.weigh(weights.detach()),
            touched=touched,
        )


def _weights(
    alphas: Float[Tensor, "r m"], cut_offs: CutOffs
) -> tuple[Float[Tensor, "r m"], Float[Tensor, "r 1"]]:
    """Alpha times transmittance, 0 from the one on that would bring a ray to its stop; the rest."""
    eps = torch.finfo(alphas.dtype).eps
    with torch.no_grad():
        behind = (1 - alphas).clamp(min=eps).cumprod(1)
    rendered = torch.where(behind > cut_offs.transmittance_min, alphas, 0.0)
    first = rendered.new_ones(len(rendered), 1)
    passing = torch.cat([first, (1 - rendered).clamp(min=eps)], dim=1)
    transmittance = passing.cumprod(1)
    return rendered * transmittance[:, :-1], transmittance[:, -1:]
