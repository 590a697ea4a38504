"""Pose agreement: whether the cameras of matched images see the matches at one place in space.

A match agrees if it lies on its epipolar line (Hartley and Zisserman 2003, section 11.4) and in
front of both cameras. Wrong poses, focal lengths and conventions leave a few per cent of the
matches agreeing, right ones nearly all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from gsfw.core.scene import Scene
from gsfw.preparation.check.view_matches import ViewMatches
from gsfw.preparation.check.viewpoints import Viewpoints

OFF_LINE = 0.005
"""A match agrees to within this part of the longer side of the image: 2 pixels of a preview."""


@dataclass(frozen=True)
class Rig:
    """Poses and pinholes of ``v`` views, as they are or as they might have been meant."""

    rotations: Float[np.ndarray, "v 3 3"]
    """World to camera, OpenCV axes; may mirror."""
    translations: Float[np.ndarray, "v 3"]
    intrinsics: Float[np.ndarray, "v 3 3"]
    sizes: Float[np.ndarray, "v 2"]

    @staticmethod
    def of(viewpoints: Viewpoints, scene: Scene) -> Rig:
        """The rig as it was read, in the world of the data: in another, inverses are others."""
        scene_poses = torch.from_numpy(viewpoints.poses)
        world = scene.world_from_scene
        poses = np.stack([world.camera(pose).double().numpy() for pose in scene_poses])
        sizes = viewpoints.sizes.astype(np.float64)
        return Rig(poses[:, :3, :3], poses[:, :3, 3], viewpoints.intrinsics, sizes)

    def with_focal(self, factor: float) -> Rig:
        """All focal lengths times a factor."""
        scaled = self.intrinsics.copy()
        scaled[:, (0, 1), (0, 1)] *= factor
        return replace(self, intrinsics=scaled)

    def exchanged(self, one: int, other: int) -> Rig:
        """The rig after two views have exchanged their poses."""
        order = np.arange(len(self.rotations))
        order[[one, other]] = other, one
        return replace(self, rotations=self.rotations[order], translations=self.translations[order])


@dataclass(frozen=True)
class Triangulation:
    """``m`` matches as rays of two cameras."""

    distances: Float[np.ndarray, " m"]
    """Signed distance in pixels from the epipolar lines, to first order (Sampson 1982)."""
    slopes: Float[np.ndarray, "m 2 2"]
    """By how much that grows with the pixel (x, y) in the first image and in the second."""
    on_line: Bool[np.ndarray, " m"]
    """True for those that lie on their epipolar lines."""
    depths: Float[np.ndarray, "m 2"]
    """Along the axes of both cameras, where the rays are nearest to each other; negative behind."""
    angles: Float[np.ndarray, " m"]
    """Degrees between the rays."""

    @property
    def agrees(self) -> Bool[np.ndarray, " m"]:
        """True for matches that agree with the cameras."""
        return self.on_line & (self.depths > 0).all(1)

    @staticmethod
    def of(matches: ViewMatches, rig: Rig) -> Triangulation:
        """Triangulate the matches by a rig."""
        first, second = matches.pairs[matches.pair].T
        rays = _rays(matches.first, rig.intrinsics[first])
        others = _rays(matches.second, rig.intrinsics[second])
        turns, shifts = _relative(rig, first, second)
        turned = np.einsum("mij,mj->mi", turns, rays)
        # Rays as seen by the second camera: z1 turned + shift = z2 others.
        normals = np.cross(shifts, turned)
        back = np.einsum("mji,mj->mi", turns, np.cross(others, shifts))
        slopes = np.stack(
            [
                back[:, :2] / rig.intrinsics[first, 0, 0][:, None],
                normals[:, :2] / rig.intrinsics[second, 0, 0][:, None],
            ],
            axis=1,
        )
        lengths = np.sqrt(np.maximum(np.square(slopes).sum((1, 2)), 1e-30))
        distances = (others * normals).sum(1) / lengths
        longest = rig.sizes.max(1)
        allowed = OFF_LINE * (longest[first] + longest[second]) / 2
        depths = _depths(turned, others, shifts)
        cosines = (turned * others).sum(1)
        cosines /= np.linalg.norm(turned, axis=1) * np.linalg.norm(others, axis=1)
        angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
        on_line = np.abs(distances) < allowed
        return Triangulation(distances, slopes / lengths[:, None, None], on_line, depths, angles)


def agreement(matches: ViewMatches, rig: Rig) -> Float[np.ndarray, " q"]:
    """Part of the matches of each pair that agree with the rig."""
    agrees = Triangulation.of(matches, rig).agrees
    counts = np.bincount(matches.pair, minlength=len(matches.pairs))
    return np.bincount(matches.pair, agrees, len(matches.pairs)) / np.maximum(counts, 1)


def _rays(
    pixels: Float[np.ndarray, "m 2"], intrinsics: Float[np.ndarray, "m 3 3"]
) -> Float[np.ndarray, "m 3"]:
    """Directions of depth 1."""
    focals = np.stack([intrinsics[:, 0, 0], intrinsics[:, 1, 1]], axis=1)
    flat = (pixels - intrinsics[:, :2, 2]) / focals
    return np.concatenate([flat, np.ones((len(flat), 1))], axis=1)


def _relative(
    rig: Rig, first: np.ndarray, second: np.ndarray
) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3"]]:
    """Rotations and translations from the axes of the first camera to those of the second."""
    turns = np.einsum("mij,mkj->mik", rig.rotations[second], rig.rotations[first])
    shifts = rig.translations[second] - np.einsum("mij,mj->mi", turns, rig.translations[first])
    return turns, shifts


def _depths(
    turned: Float[np.ndarray, "m 3"],
    others: Float[np.ndarray, "m 3"],
    shifts: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 2"]:
    """Least squares of z1 turned - z2 others = -shifts; 0 for parallel rays."""
    own, both, other = (
        (a * b).sum(1) for a, b in ((turned, turned), (turned, others), (others, others))
    )
    left, right = -(turned * shifts).sum(1), (others * shifts).sum(1)
    determinant = own * other - both**2
    safe = np.where(determinant > 1e-18, determinant, np.inf)
    return (
        np.stack([left * other + both * right, both * left + own * right], axis=1) / safe[:, None]
    )
