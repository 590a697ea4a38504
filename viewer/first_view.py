"""FirstView: the view of a page that opens, its upward direction, and the size of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.maths.axes import known_axis
from gsfw.core.maths.camera_path import gathered, up_direction, viewing_center
from gsfw.core.maths.inner_box import inner_box
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.splats import Sh, Splats
from gsfw.viewer.view_state import Box, Pose, Vector
from gsfw.viewer.viewed_model import ViewedModel


@dataclass(frozen=True)
class FirstView:
    """The view of a page that opens, its upward direction, and the size of the scene."""

    pose: Pose
    target: Vector
    """The point to orbit around."""
    up: Vector
    bounds: Box
    """Box of nearly all Gaussians at the first time."""
    size: float
    """Length to draw cameras by, in scene units: the size of the scene."""
    sh_degree: int
    """Largest degree that the colours may have; 0 if they do not depend on the view."""


@torch.no_grad()
def first_view(model: ViewedModel) -> FirstView:
    """The first view of a model: that of its first camera."""
    moment = torch.tensor(0.0, device=model.device) if model.is_dynamic else None
    splats = model.model.splats(moment)
    bounds = _bounds(splats)
    degree = degree_of(splats.colors.width) if isinstance(splats.colors, Sh) else 0
    cameras = model.data.views(Split.TRAIN).cameras
    up = _up(model, cameras)
    first = cameras[0].to("cpu")
    seen = Pose.of(first)
    axis = first.world_to_camera[0, 2, :3].double()
    position = torch.tensor(seen.position, dtype=torch.float64)
    target = viewing_center(gathered(cameras))
    distance = max(float((target - position) @ axis), 0.2 * model.scene.extent)
    place = _vector(position + distance * axis)
    return FirstView(seen, place, _vector(up), bounds, max(model.scene.extent, 1e-6), degree)


def _up(model: ViewedModel, cameras: Sequence[Cameras]) -> Tensor:
    """The upward direction in the scene frame: as the data says, else that of its cameras."""
    world = known_axis(model.scene.up)
    if world is None:
        return up_direction(gathered(cameras))
    return _unit(model.scene.world_from_scene.rotation.T @ world)


def _bounds(splats: Splats) -> Box:
    """The box of nearly all Gaussians."""
    means = splats.means.detach().float().cpu()
    means = means[means.isfinite().all(1)]
    if not len(means):
        return Box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    low, high = inner_box(means)
    return Box(_vector(low), _vector(high))


def _unit(vector: Tensor) -> Tensor:
    return vector / vector.norm()


def _vector(values: Tensor) -> Vector:
    x, y, z = values.tolist()
    return float(x), float(y), float(z)
