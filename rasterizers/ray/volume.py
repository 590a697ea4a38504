"""Volume: the same Gaussians as a density, integrated along each ray by samples.

The density is sigma(x) = sum_i sigma_i G_i(x), which emits the mean of the colours c_i by their
share of it. N samples between where a ray enters the first Gaussian and leaves the last give

    C = sum_k T_k (1 - exp(-sigma(x_k) h)) c(x_k),   T_k = exp(-sum_j<k sigma(x_j) h)

(Mildenhall et al. 2020, "NeRF", equation 3, after Max 1995); h is 1/N of the distance, and the
sample the middle of its interval or a random point of it (there equation 2). Gaussians that overlap
mix: there is no order. On a ray, G_i is exp(-D_i^2 / 2) times a normal curve of deviation tau about
t*, 1 / tau^2 = d^T Sigma_i^-1 d, and its integral exp(-D_i^2 / 2) sqrt(2 pi) tau. The peak density

    sigma_i = -ln(1 - o_i) / (sqrt(2 pi) tau_i),   tau_i on the ray through the mean,

gives a lone Gaussian the alpha o_i there, as splatting has it: 1 - exp(-integral). Elsewhere the
two differ, since 1 - (1 - o)^exp(-D^2 / 2) is not o exp(-D^2 / 2). The density of a flat Gaussian
depends on where it is seen from, as its opacity in splatting does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.numerics import NumericsProfile
from gsfw.rasterizers.ray.camera_rays import Rays
from gsfw.rasterizers.ray.gaussians import Gaussians
from gsfw.rasterizers.ray.mode import Blended, Mode
from gsfw.rasterizers.ray.response import face_normals, respond
from gsfw.rasterizers.reference.tile_buffer import CutOffs

SUPPORT = 5.0
"""Deviations along the ray to which a Gaussian is sampled; 6e-7 of its integral lie beyond."""

THINNEST = 1e-6
"""Least thickness as a part of the extent: samples could not find a thinner sheet."""

CLEAR = 1e-30
"""Density below which there is nothing to take a mean colour of."""

TILE_SEED = 1_000_003
"""A prime, by which the seeds of tiles are apart: torch's generator on the CPU reads 32 bits."""

OPAQUE = 100.0
"""Optical depth of a step at which it is cut off: exp(-100) is 0 to every colour."""


@dataclass(frozen=True)
class Volume(Mode):
    """Sees Gaussians all at once."""

    samples: int = 64
    """Per ray."""
    seed: int | None = None
    """Seed of random samples, one per interval, the same each time an image is rendered; ``None``
    for the middles."""

    def pairs(self) -> int:
        """One evaluation per sample and Gaussian."""
        return self.samples

    def offsets(self, rays: int, tile: int) -> Float[Tensor, "r s"]:
        """Position of each sample of each ray of a tile within its interval, in [0, 1)."""
        if self.seed is None:
            return torch.full((rays, self.samples), 0.5)
        generator = torch.Generator().manual_seed(self.seed + TILE_SEED * tile)
        return torch.rand(rays, self.samples, generator=generator)

    def blend(
        self,
        rays: Rays,
        offsets: Float[Tensor, "r s"],
        gaussians: Gaussians,
        channels: Float[Tensor, "m d"],
        profile: NumericsProfile,
    ) -> Blended:
        """See Gaussians with their ``channels``; differentiable."""
        curves = _curves(rays, gaussians, profile)
        low, high = _span(curves, rays.central)
        step = (high - low) / self.samples
        places = low + (offsets + torch.arange(self.samples).to(low)) * step
        densities = _densities(places, curves)
        density = densities.sum(2)
        depth = (density * step).clamp(max=OPAQUE)
        ahead = depth.cumsum(1)
        weights = (depth - ahead).exp() * -torch.expm1(-depth)
        # The colour of a sample is the mean of the channels there.
        seen = density > CLEAR
        shares = torch.where(seen, weights, 0.0) / torch.where(seen, density, 1.0)
        by_gaussian = (shares[:, :, None] * densities).sum(1)
        depths = rays.origins[:, 2:] + places * rays.directions[:, 2:]
        return Blended(
            channels=by_gaussian @ channels,
            depths=(weights * depths).sum(1, keepdim=True),
            weights=weights.sum(1, keepdim=True),
            left=(-ahead[:, -1:]).exp(),
            contributions=rays.weigh(by_gaussian.detach()),
            touched=curves.met,
        )


@dataclass(frozen=True)
class _Curves:
    """Along each ray, each Gaussian as a normal curve."""

    met: Bool[Tensor, "r m"]
    """True where the Gaussian alone would be seen, by the cut-off of alpha that splatting has."""
    peaks: Float[Tensor, "r m"]
    deviations: Float[Tensor, "r m"]
    """Tau, in scene units."""
    heights: Float[Tensor, "r m"]
    """Density at the peak; 0 where not met."""


def _curves(rays: Rays, gaussians: Gaussians, profile: NumericsProfile) -> _Curves:
    response = respond(rays, gaussians)
    eps = torch.finfo(response.falloff.dtype).eps
    cut_offs = CutOffs.of(profile, response.falloff.dtype)
    met = gaussians.opacities * response.falloff > max(cut_offs.alpha_below, 0.0)
    met &= response.falloff > 0
    columns = gaussians.axes.transpose(1, 2)
    towards = gaussians.centres / gaussians.extents[:, None]
    if rays.central:
        straight = torch.nn.functional.normalize(towards, dim=1)
    else:
        straight = rays.directions[:1].expand_as(towards)
    through = (face_normals(columns) @ straight[:, :, None])[:, :, 0]
    sections = torch.linalg.vector_norm(through, dim=1)
    opacities = gaussians.opacities.clamp(max=min(profile.alpha_max, 1 - eps))
    depths = -torch.log1p(-opacities) * response.falloff * sections / response.sections
    bodies = gaussians.extents * torch.linalg.vector_norm(_volumes(columns), dim=1)
    thinnest = torch.maximum(THINNEST * gaussians.extents, eps * response.peaks.detach().abs())
    deviations = torch.maximum(bodies / response.sections, thinnest)
    heights = torch.where(met, depths, 0.0) / (math.sqrt(2 * math.pi) * deviations)
    return _Curves(met, response.peaks, deviations, heights)


def _volumes(columns: Float[Tensor, "m k 3"]) -> Float[Tensor, "m t"]:
    """Determinants of every three columns, the sum of whose squares is that of the covariance."""
    first, second, third = (
        list(numbers) for numbers in zip(*combinations(range(columns.shape[1]), 3), strict=True)
    )
    normals = torch.linalg.cross(columns[:, first], columns[:, second])
    return (normals * columns[:, third]).sum(2)


def _span(curves: _Curves, central: bool) -> tuple[Float[Tensor, "r 1"], Float[Tensor, "r 1"]]:
    """Entry of each ray into the first Gaussian on it, and exit from the last."""
    reach = SUPPORT * curves.deviations
    low = torch.where(curves.met, curves.peaks - reach, torch.inf)
    high = torch.where(curves.met, curves.peaks + reach, -torch.inf)
    if central:
        low, high = low.clamp(min=0), high.clamp(min=0)
    # A column more, because there may be no Gaussian to take the first or the last of.
    none = reach.new_zeros(len(reach), 1)
    first = torch.cat([low, none + torch.inf], dim=1).amin(1, keepdim=True)
    last = torch.cat([high, none - torch.inf], dim=1).amax(1, keepdim=True)
    meets = curves.met.any(1, keepdim=True)
    return torch.where(meets, first, 0.0), torch.where(meets, last, 0.0)


def _densities(places: Float[Tensor, "r s"], curves: _Curves) -> Float[Tensor, "r s m"]:
    """The density of each Gaussian at each sample."""
    away = places[:, :, None] - curves.peaks[:, None]
    deviations = curves.deviations[:, None]
    inside = away.detach().abs() < 2 * SUPPORT * deviations
    turns = torch.where(inside, away, 0.0) / deviations
    curve = (-0.5 * turns.square()).exp() * inside
    return curves.heights[:, None] * curve
