"""Alignment: the direction of gravity, the height of the floor, and the true size of a scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.maths.camera_path import up_direction
from gsfw.core.maths.similarity import Similarity
from gsfw.editing.transforms import rotation_between, scale

MIN_TURN = 0.02
"""Least second eigenvalue of the mean outer product of the cameras' x axes (its trace is 1) for
which these span a plane: 0.02 are cameras that face 8 degrees to one side and to the other."""
PLANES = 2000
"""Tried planes through three splats: a floor of a fifth of all splats is missed by all of them with
probability (1 - 0.2^3)^2000 = 1e-7, one of a tenth with 0.14."""
SAMPLE, VOTERS = 50_000, 5_000
"""Most splats that a floor is fitted to, and that vote for planes; they bound the time."""
LARGEST_TILT = 40.0
"""Largest angle between the floor's normal and the upward direction that is known, in degrees."""
THICKNESS = 0.01
"""Half the thickness of a floor, in sizes of the scene (from the 5th to the 95th percentile)."""
BELOW = 0.1
"""Part of the splats that may lie below a floor: reflections, floaters, and its own thickness."""
LEAST_FLOOR = 0.03
"""Part of the splats that a floor has at least."""
OPAQUE = 0.1
"""Opacity of the splats that vote."""


def up_of_cameras(cameras: Sequence[Cameras]) -> Float64[Tensor, " 3"]:
    """The upward direction of cameras that are held level, in their frame; unit length.

    The x axes of cameras without roll are level whatever their pitch, so that the direction at
    right angles to all of them is upward. Cameras that face one way do not determine it; for them
    it is the mean of their own upward directions.
    """
    together = [camera.world_to_camera[0].double().cpu() for camera in cameras]
    right = torch.stack([pose[0, :3] for pose in together])
    up = -torch.stack([pose[1, :3] for pose in together]).mean(0)
    values, vectors = torch.linalg.eigh(right.T @ right / len(right))
    if float(values[1]) < MIN_TURN:
        return up_direction(cameras[0]) if len(cameras) == 1 else up / up.norm().clamp_min(1e-12)
    found = vectors[:, 0]
    return found if float(found @ up) >= 0 else -found


@dataclass(frozen=True)
class Floor:
    """A plane that nearly everything lies above."""

    normal: Float64[Tensor, " 3"]
    """Upward, unit length."""
    height: float
    """Distance of the plane from the origin, along its normal, in the units of the points."""
    part: float
    """Part of the points that lie on it."""


def fit_floor(
    means: Float[Tensor, "n 3"],
    opacities: Float[Tensor, " n"],
    up: Float64[Tensor, " 3"],
    tilt: float = LARGEST_TILT,
) -> Floor:
    """Find the floor of a scene: the plane of most splats with nearly nothing below.

    Random planes through three splats vote (RANSAC, Fischler and Bolles 1981); the best one is
    then fitted to its splats by least squares. The same input gives the same floor.

    Args:
        means: centres of the splats.
        opacities: faint ones do not vote.
        up: roughly upwards.
        tilt: largest angle of the normal from ``up``, in degrees; 0 keeps it.

    Raises:
        ValueError: there is no such plane.
    """
    generator = torch.Generator().manual_seed(0)
    points = means.double()[opacities >= OPAQUE]
    if len(points) < 3:
        raise ValueError(f"{len(points)} splats are opaque, and a floor needs three at least")
    points = points[torch.randperm(len(points), generator=generator)[:SAMPLE]]
    middle = points.median(0).values
    ends = torch.quantile(points, torch.tensor([0.05, 0.95], dtype=torch.float64), dim=0)
    size = float((ends[1] - ends[0]).norm())
    points = (points - middle) / max(size, 1e-12)
    best = _vote(points[:VOTERS], up, tilt, generator)
    if best is None:
        raise ValueError(
            f"no plane within {tilt:g} degrees of level has {LEAST_FLOOR:.0%} of the splats on it "
            f"and at most {BELOW:.0%} of them below"
        )
    normal, height = best
    for _ in range(3):  # Least squares, among splats that the fit itself chooses.
        on_it = points[(points @ normal - height).abs() <= THICKNESS]
        center = on_it.mean(0)
        if tilt > 0:
            axis = torch.linalg.eigh((on_it - center).T @ (on_it - center))[1][:, 0]
            normal = axis if float(axis @ up) > 0 else -axis
        height = float(normal @ center)
    part = float(((points @ normal - height).abs() <= THICKNESS).double().mean())
    return Floor(normal, height * size + float(normal @ middle), part)


def _vote(
    points: Float64[Tensor, "n 3"],
    up: Float64[Tensor, " 3"],
    tilt: float,
    generator: torch.Generator,
) -> tuple[Float64[Tensor, " 3"], float] | None:
    """Normal and height of the plane with the most votes; ``None`` if none is a floor."""
    if tilt > 0:
        triples = points[torch.randint(len(points), (PLANES, 3), generator=generator)]
        first, second = triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0]
        normals = torch.linalg.cross(first, second)
        lengths = normals.norm(dim=1)
        triples, normals = triples[lengths > 1e-12], normals[lengths > 1e-12]
        normals = normals / normals.norm(dim=1, keepdim=True)
        normals = normals * (normals @ up).sign()[:, None]
        level = normals @ up >= math.cos(math.radians(tilt))
        normals, starts = normals[level], triples[level, 0]
    else:
        starts = points[torch.randint(len(points), (PLANES,), generator=generator)]
        normals = up.expand_as(starts)
    heights = (normals * starts).sum(1)
    best, most = None, LEAST_FLOOR
    for normal, height in zip(normals, heights.tolist(), strict=True):
        above = points @ normal - height
        part = float((above.abs() <= THICKNESS).double().mean())
        if part > most and float((above < -THICKNESS).double().mean()) <= BELOW:
            best, most = (normal, height), part
    return best


def turned_upright(up: Float64[Tensor, " 3"], axis: Float64[Tensor, " 3"]) -> Similarity:
    """The rotation by the smallest angle that turns ``up`` into ``axis``; both of unit length."""
    return Similarity(rotation=rotation_between(up, axis))


def true_size(
    start: Float64[Tensor, " 3"], end: Float64[Tensor, " 3"], distance: float
) -> Similarity:
    """The scaling after which two points of the world are ``distance`` apart.

    Raises:
        ValueError: they are one point, or the distance is not positive.
    """
    found = float((end - start).norm())
    if not found > 0:
        raise ValueError("the two points are the same")
    if not distance > 0:
        raise ValueError(f"a distance of {distance:g}: expected a positive number")
    return scale(distance / found)
