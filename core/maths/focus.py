"""Camera geometry of a capture: the point that cameras look at, and the sphere that they lie on."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.scene import Scene

CAMERA_CLEARANCE = 1e-2
"""Points nearer to a camera than this, in extents, are triangulated cameras or noise. Splats there
cover whole images, and one at the centre of a camera has no projection (graphdeco issue 41)."""
OBJECT_SIZE = 0.33
"""Half of the box of an object's random points, in distances of its cameras: NeRF-synthetic has
cameras at 4.03 and, in the code of Kerbl et al. 2023, points within 1.3."""
ROUNDNESS = 0.1
"""Cameras lie on a sphere if their distances from its centre differ by less, relatively, and look
at one point if the distance of their axes from it is less."""
MIN_AXES = 2
"""Least number of cameras with a common point."""


def object_place(scene: Scene) -> tuple[Float[Tensor, " 3"], float] | None:
    """Position of the object that all cameras surround, and its distance from them.

    Returns:
        Position and distance in scene units; ``None`` when the cameras surround no object.
    """
    return fitted_sphere(scene.camera_centers, 1.5 * scene.extent) or focus(scene)


def focus(scene: Scene) -> tuple[Float[Tensor, " 3"], float] | None:
    """The point that all cameras look at, and their mean distance; ``None`` if there is none.

    It is the one nearest to all viewing axes: sum over axes (1 - a a^T)(x - c) = 0.
    """
    if scene.camera_axes is None or len(scene.camera_axes) < MIN_AXES:
        return None
    axes, centers = scene.camera_axes.double(), scene.camera_centers.double()
    across = torch.eye(3, dtype=torch.float64) - axes[:, :, None] * axes[:, None, :]
    # Parallel axes meet nowhere, and the least-norm answer is then behind or beside the cameras.
    right = (across @ centers[:, :, None]).sum(0)
    point = (torch.linalg.pinv(across.sum(0), rcond=1e-6) @ right)[:, 0]
    ahead = ((point - centers) * axes).sum(1)
    missed = (across @ (point - centers)[:, :, None])[:, :, 0].norm(dim=1)
    if bool((ahead <= 0).any()) or bool((missed > ROUNDNESS * ahead).any()):
        return None
    return point.to(scene.camera_centers), float(ahead.mean())


def fitted_sphere(
    centers: Float[Tensor, "v 3"], largest: float
) -> tuple[Float[Tensor, " 3"], float] | None:
    """Centre and radius of the sphere through camera positions; ``None`` if they are on none.

    |x - m|^2 = r^2 is linear in m and r^2 - |m|^2. Where the cameras lie in a plane, the solution
    of least norm is the centre of their circle.

    Args:
        centers: positions of the cameras.
        largest: radius above which the fit is rejected.
    """
    mean = centers.mean(dim=0)
    offsets = (centers - mean).double()
    system = torch.cat([2.0 * offsets, torch.ones(len(offsets), 1, dtype=torch.float64)], dim=1)
    solution = torch.linalg.pinv(system, rcond=1e-2) @ offsets.square().sum(1)
    distances = (offsets - solution[:3]).norm(dim=1)
    radius = float(distances.mean())
    round_enough = float((distances - radius).abs().max()) <= ROUNDNESS * radius
    if len(centers) < 4 or radius > largest or not round_enough:
        return None
    return mean + solution[:3].to(mean), radius
