"""Initialisation of Gaussians: at surface points, at random, or from the splats of a file.

Kerbl et al. 2023, section 5.1: isotropic, with the mean distance to the three nearest points.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.config import AUTO
from gsfw.core.errors import DataError
from gsfw.core.maths.focus import CAMERA_CLEARANCE, OBJECT_SIZE, object_place
from gsfw.core.maths.spherical_harmonics import num_coefficients, rgb_to_dc
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.sky import Sky
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.model import GaussianParameters

NEIGHBORS = 3
MIN_SPACING = 1e-7
"""Least distance, in extents: smaller splats would be invisible."""
LONE_SPACING = 1e-2
"""Size of a point that has no neighbour, in extents."""
MIN_OPACITY, MAX_OPACITY = 1e-6, 1 - 1e-6
"""Bound of the opacities of a file: a saturated sigmoid has no gradient."""
MIN_SCALE = 1e-10
ROOM_SIZE = 3.0
"""Half of the box of any other scene's random points, in extents: it includes the background behind
the objects that the cameras surround."""
SKY_OPACITY = 0.9
"""Initial opacity of the sky, which nothing is behind: with 0.1 near splats take its colours first
(0.8 dB less on an outdoor capture after 600 steps)."""
CHUNK = 65_536


def usable_points(
    scene: Scene,
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"], dict[str, int]]:
    """The scene's points to start from, their colours, and the omitted points by cause."""
    rows, dropped = usable_rows(scene)
    return scene.points[rows], scene.point_colors[rows], dropped


def usable_rows(scene: Scene) -> tuple[Int[Tensor, " p"], dict[str, int]]:
    """Indices of the scene's points to start from, and the number of omitted points by cause."""
    rows = torch.arange(len(scene.points))
    dropped: dict[str, int] = {}

    def keep(chosen: Tensor, reason: str) -> None:
        nonlocal rows
        if chosen.sum() < len(rows):
            dropped[reason] = len(rows) - int(chosen.sum())
            rows = rows[chosen]

    keep(scene.points.isfinite().all(1) & scene.point_colors.isfinite().all(1), "not finite")
    keep(_first_of_each(scene.points[rows]), "a copy of another")
    keep(_clear_of_cameras(scene.points[rows], scene), "at a camera")
    return rows, dropped


def _first_of_each(points: Float[Tensor, "p 3"]) -> Tensor:
    chosen = torch.zeros(len(points), dtype=torch.bool)
    if len(points):
        _, first = np.unique(points.numpy(), axis=0, return_index=True)
        chosen[torch.from_numpy(first)] = True
    return chosen


def _clear_of_cameras(points: Float[Tensor, "p 3"], scene: Scene) -> Tensor:
    """True for points that are far enough from every camera."""
    nearest = [
        torch.cdist(chunk, scene.camera_centers, compute_mode="donot_use_mm_for_euclid_dist").amin(
            dim=1
        )
        for chunk in points.split(CHUNK)
    ]
    return torch.cat(nearest) >= CAMERA_CLEARANCE * scene.extent


def from_points(
    points: Float[Tensor, "p 3"],
    colors: Float[Tensor, "p 3"],
    *,
    extent: float,
    scale: float,
    opacity: float,
    sh_degree: int,
    operators: Operators,
) -> GaussianParameters:
    """Make one isotropic Gaussian at each point.

    Args:
        points: at least one, all distinct, in the scene frame.
        colors: colours, in [0, 1].
        extent: extent of the scene.
        scale: standard deviation, in mean distances to the three nearest points.
        opacity: opacity of all Gaussians.
        sh_degree: coefficients above the constant one start at zero.
        operators: for nearest neighbours.
    """
    count = len(points)
    spacing = _spacing(operators.neighbor_distances(points, NEIGHBORS), extent)
    sh = torch.zeros(count, num_coefficients(sh_degree), 3)
    sh[:, 0] = rgb_to_dc(colors)
    return GaussianParameters(
        means=points.clone(),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        log_scales=(spacing * scale).log()[:, None].repeat(1, 3),
        opacity_logits=torch.full((count,), opacity).logit(),
        sh=sh,
    )


def with_sky(
    start: GaussianParameters, sky: Sky, sh_degree: int, operators: Operators
) -> GaussianParameters:
    """Append one opaque Gaussian at each point of a sky."""
    far = from_points(
        sky.points,
        sky.colors,
        extent=sky.radius,
        scale=1.0,
        opacity=SKY_OPACITY,
        sh_degree=sh_degree,
        operators=operators,
    )
    joined = {name: torch.cat([part, vars(far)[name]]) for name, part in vars(start).items()}
    return GaussianParameters(**joined)


def _spacing(distances: Float[Tensor, "p k"], extent: float) -> Float[Tensor, " p"]:
    """Mean distance to the existing neighbours."""
    there = distances.isfinite()
    count = there.sum(1)
    mean = torch.where(there, distances, 0.0).sum(1) / count.clamp_min(1)
    mean = torch.where(count > 0, mean, LONE_SPACING * extent)
    return mean.clamp_min(MIN_SPACING * extent)


def random_points(
    scene: Scene, count: int, generator: torch.Generator, region: str = AUTO
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """Uniform points and colours in a box of the region that the cameras see."""
    center, half = random_box(scene, region)
    positions = 2.0 * torch.rand(count, 3, generator=generator) - 1.0
    return center + half * positions, torch.rand(count, 3, generator=generator)


def random_box(scene: Scene, region: str = AUTO) -> tuple[Float[Tensor, " 3"], float]:
    """Centre and half of the side of the box of random points.

    Images with alpha show an object. If their cameras surround it on a sphere, the object is at its
    centre; if they look at one point, it is there. Captures without alpha fill the surroundings of
    their cameras, unless ``region`` is "object".
    """
    center = scene.camera_centers.mean(dim=0)
    if region == "surroundings" or (region == AUTO and not scene.has_alpha):
        return center, ROOM_SIZE * scene.extent
    place = object_place(scene)
    return (center, scene.extent) if place is None else (place[0], OBJECT_SIZE * place[1])


def from_splats(splats: Splats, sh_degree: int) -> GaussianParameters:
    """Parameters from the splats of a file, in the scene frame; cuts or pads to ``sh_degree``.

    Raises:
        DataError: the file contains no splats, or values that are not finite.
    """
    assert isinstance(splats.colors, Sh)
    assert splats.quats is not None
    assert splats.scales is not None
    if len(splats) == 0:
        raise DataError(
            "init: the file contains no splats.", "Start from init=points or init=random."
        )
    for name, tensor in splats.tensors().items():
        if not bool(tensor.isfinite().all()):
            raise DataError(
                f"init: the {name} of the file hold values that are not finite.",
                "Export the file again, or start from init=points or init=random.",
            )
    sh = torch.zeros(len(splats), num_coefficients(sh_degree), 3)
    given = splats.colors.dense()[:, : sh.shape[1]]
    sh[:, : given.shape[1]] = given
    return GaussianParameters(
        means=splats.means.clone(),
        quats=splats.quats.clone(),
        log_scales=splats.scales.clamp_min(MIN_SCALE).log(),
        opacity_logits=splats.opacities.clamp(MIN_OPACITY, MAX_OPACITY).logit(),
        sh=sh,
    )


def degrees_of(sh: Float[Tensor, "n k 3"]) -> Int[Tensor, " n"]:
    """Highest degree of each row with a coefficient that is not zero."""
    there = (sh != 0).any(dim=2)
    last = torch.where(there, torch.arange(sh.shape[1]), 0).amax(dim=1)
    return (last + 0.5).sqrt().long()
