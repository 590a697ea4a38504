"""Response: what rays meet of Gaussians, without inverting a covariance.

On the ray o + t d the Gaussian of mean mu and covariance Sigma has the squared distance

    D^2(t) = (o + t d - mu)^T Sigma^-1 (o + t d - mu),   least at
    t* = d^T Sigma^-1 (mu - o) / d^T Sigma^-1 d,

the point of largest response (Moenne-Loccoz et al. 2024, "3D Gaussian Ray Tracing", section 4; Yu
et al. 2024, "Gaussian Opacity Fields", section 4). Both go to the Gaussian's own frame, S^-1 R^T,
which divides by scales. We multiply by the determinant instead, with Sigma = F F^T, F of columns f:

    D^2(t*) = sum_i (f_i . d x (mu - o))^2 / sum_i<j (f_i x f_j . d)^2
    t*      = d^T A (mu - o) / d^T A d,   A = adj Sigma = sum_i<j (f_i x f_j) (f_i x f_j)^T.

The first is the Gaussian's marginal across the ray, its 2 x 2 inverse written by Lagrange's
identity. Nothing is divided by a scale, squares are summed only, so that needles keep their digits,
a scale of 0 is a disc like any other, and F may have the two further columns of a dilation. A
numerator is linear in the Plucker coordinates (d, d x o) of the ray: all are one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.rasterizers.ray.camera_rays import Rays
from gsfw.rasterizers.ray.gaussians import Gaussians

SLIVER = 1e-15
"""Part of the squared extent: a ray misses a Gaussian whose section has less area; the
gradient of its reciprocal would not fit float32."""

FAINTEST = 100.0
"""Distance from which on a response counts as 0, which it is in float64 from 39 on."""


@dataclass(frozen=True)
class Response:
    """Responses of ``m`` Gaussians on ``r`` rays."""

    falloff: Float[Tensor, "r m"]
    """exp(-D^2 / 2) where it is largest; 0 where the ray does not meet the Gaussian."""
    peaks: Float[Tensor, "r m"]
    """t*, in scene units; anything where the falloff is 0."""
    sections: Float[Tensor, "r m"]
    """Root of d^T A d, in squared extents; 1 where the falloff is 0."""


def respond(rays: Rays, gaussians: Gaussians) -> Response:
    """Evaluate all pairs of a ray and a Gaussian."""
    count = len(gaussians.extents)
    columns = gaussians.axes.transpose(1, 2)
    centres = gaussians.centres / gaussians.extents[:, None]
    turns = torch.linalg.cross(centres[:, None].expand_as(columns), columns)
    moments = rays.directions @ turns.reshape(-1, 3).T
    if not rays.central:
        shifts = torch.linalg.cross(rays.directions, rays.origins)
        moments = moments - shifts @ (columns / gaussians.extents[:, None, None]).reshape(-1, 3).T
    moments = moments.view(len(rays.directions), count, columns.shape[1])
    normals = face_normals(columns)
    faces = rays.directions @ normals.reshape(-1, 3).T
    faces = faces.view(len(rays.directions), count, normals.shape[1])
    sections = torch.linalg.vector_norm(faces, dim=2)
    met = (sections > SLIVER) & (moments.detach().abs().amax(2) < FAINTEST * sections)
    # Missed sections are replaced before the division: their gradient would be 0 times infinity.
    sections = torch.where(met, sections, 1.0)
    distances = torch.where(met[:, :, None], moments, 0.0) / sections[:, :, None]
    falloff = torch.where(met, (-0.5 * distances.square().sum(2)).exp(), 0.0)
    return Response(falloff, _peaks(rays, gaussians, normals, sections), sections)


def face_normals(columns: Float[Tensor, "m k 3"]) -> Float[Tensor, "m p 3"]:
    """f_i x f_j for every pair i < j."""
    first, second = zip(*combinations(range(columns.shape[1]), 2), strict=True)
    return torch.linalg.cross(columns[:, list(first)], columns[:, list(second)])


def _peaks(
    rays: Rays,
    gaussians: Gaussians,
    normals: Float[Tensor, "m p 3"],
    sections: Float[Tensor, "r m"],
) -> Float[Tensor, "r m"]:
    adjoints = normals.transpose(1, 2) @ normals
    towards = (adjoints @ gaussians.centres[:, :, None])[:, :, 0]
    along = rays.directions @ towards.T
    if not rays.central:
        places = rays.directions[:, :, None] * rays.origins[:, None]
        along = along - places.flatten(1) @ adjoints.flatten(1).T
    return along / sections / sections
