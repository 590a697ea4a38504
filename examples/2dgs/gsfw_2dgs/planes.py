"""Planes: the exact depth of the ray-splat intersection, through extra channels of any rasterizer.

A surfel with the normal n and the centre c, in camera axes, meets the ray d = (u, v, 1) of a pixel
at the depth z = (n . c) / (n . d). So its inverse depth is linear in the pixel,

    q(u, v) = (n . d) / (n . c) = a u + b v + e,

and the blended sums over the surfels of a pixel, with weights w_i,

    sum w_i q_i   = u sum w_i a_i + v sum w_i b_i + sum w_i e_i,
    sum w_i q_i^2 = a quadratic form of (u, v, 1) in the blended products of a_i, b_i, e_i,

follow from nine blended channels that do not depend on the pixel.
"""

from __future__ import annotations

import torch

from gsfw.api import rotation_matrices

CHANNELS = 12
"""Normal, plane, and the six products of the plane's numbers."""
PRODUCTS = ((0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0), (0, 1, 2.0), (0, 2, 2.0), (1, 2, 2.0))
"""Pairs of (u, v, 1), and how often each is in the square."""
LEAST_COSINE = 0.1
"""Surfels seen at a smaller cosine keep their depth at the centre, and this slope: at the edge of a
plane the slope of its inverse depth has no bound."""


def plane_channels(means, quats, camera):
    """Channels [n, 12] of surfels seen by one camera, in its axes."""
    pose = camera.world_to_camera[0]
    centers = means @ pose[:3, :3].T + pose[:3, 3]
    normals = rotation_matrices(quats)[:, :, 2] @ pose[:3, :3].T
    away = (normals * centers).sum(1, keepdim=True) > 0
    normals = torch.where(away, -normals, normals)
    distances = centers.norm(dim=1).clamp_min(1e-6)
    facing = torch.minimum((normals * centers).sum(1), -LEAST_COSINE * distances)
    depths = centers[:, 2]
    depths = torch.where(depths.abs() < 1e-3, 1e-3, depths)  # Not rendered: too near.
    slopes = normals[:, :2] / facing[:, None]
    offsets = 1 / depths - (slopes * centers[:, :2] / depths[:, None]).sum(1)
    plane = torch.cat([slopes, offsets[:, None]], dim=1)
    products = torch.stack([plane[:, i] * plane[:, j] for i, j, _ in PRODUCTS], dim=1)
    return torch.cat([normals, plane, products], dim=1)


def pixel_directions(camera, like):
    """(u, v, 1) of every pixel [h, w, 3]: rays of length 1 along the camera's axis."""
    matrix = camera.intrinsics[0].to(like)
    v, u = torch.meshgrid(
        torch.arange(camera.height, device=like.device) + 0.5,
        torch.arange(camera.width, device=like.device) + 0.5,
        indexing="ij",
    )
    x, y = (u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1]
    return torch.stack([x, y, torch.ones_like(x)], dim=-1).to(like.dtype)


class Surface:
    """The surface in one rendered image; all in the axes of its camera."""

    def __init__(self, rendered, camera):
        self.alpha = rendered.alpha[0]
        """[h, w, 1]"""
        self.normals, plane, products = rendered.extra[0].split([3, 3, 6], dim=-1)
        self.rays = pixel_directions(camera, plane)
        self.inverse = (plane * self.rays).sum(-1, keepdim=True)
        """Sum of weights times inverse depths, [h, w, 1]."""
        terms = [
            count * products[..., k] * self.rays[..., i] * self.rays[..., j]
            for k, (i, j, count) in enumerate(PRODUCTS)
        ]
        self.squares = torch.stack(terms).sum(0)[..., None]

    def distortion(self):
        """Sum over pairs of w_i w_j (q_i - q_j)^2, [h, w, 1]."""
        return (self.alpha * self.squares - self.inverse.square()).clamp_min(0)

    def depth(self):
        """Depth of the mean inverse depth, [h, w, 1]; 0 where nothing is."""
        solid = (self.alpha > 1e-3) & (self.inverse > 1e-6)
        return torch.where(solid, self.alpha / self.inverse.clamp_min(1e-6), 0.0)

    def depth_normals(self):
        """Unit normals of the depth, towards the camera, [h - 2, w - 2, 3]."""
        return normals_of(self.depth() * self.rays)


def normals_of(points):
    """Unit normals towards the camera of a grid of points [h, w, 3], without its border."""
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    return torch.nn.functional.normalize(torch.linalg.cross(down, across), dim=-1)
