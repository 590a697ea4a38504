"""ViewState: all that decides what a page shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.maths.rotations import quaternions_of, rotation_matrices
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Pose:
    """A place in the scene frame, and a viewing direction, with a vertical field of view."""

    position: Vector
    """In scene units."""
    wxyz: tuple[float, float, float, float]
    """Rotation from camera axes (x right, y down, z forward) to the scene frame."""
    fov: float
    """Vertical field of view, in radians."""

    def world_to_camera(self) -> Float[Tensor, "4 4"]:
        """The rigid transform from the scene to the camera, in float64."""
        turned = rotation_matrices(torch.tensor([self.wxyz], dtype=torch.float64))[0].T
        rigid = torch.eye(4, dtype=torch.float64)
        rigid[:3, :3] = turned
        rigid[:3, 3] = -(turned @ torch.tensor(self.position, dtype=torch.float64))
        return rigid

    def cameras(self, width: int, height: int, time: float | None = None) -> Cameras:
        """One pinhole camera with square pixels, in float32 on the CPU."""
        focal = 0.5 * height / math.tan(0.5 * self.fov)
        lens = [[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]]
        return Cameras(
            world_to_camera=self.world_to_camera()[None].float(),
            intrinsics=torch.tensor([lens]),
            width=width,
            height=height,
            time=None if time is None else torch.tensor([time]),
        )

    @staticmethod
    def of(camera: Cameras) -> Pose:
        """The pose of one camera; its principal point is taken for the middle of the image."""
        rotation = camera.world_to_camera[0, :3, :3].detach().cpu().double().T
        position = camera.centers[0].detach().cpu().double()
        focal = float(camera.intrinsics[0, 1, 1])
        w, x, y, z = quaternions_of(rotation[None])[0].tolist()
        px, py, pz = position.tolist()
        return Pose((px, py, pz), (w, x, y, z), 2.0 * math.atan2(0.5 * camera.height, focal))


@dataclass(frozen=True)
class Box:
    """An axis-aligned box of the scene frame; Gaussians outside of it are not shown."""

    low: Vector
    high: Vector


class Comparison(Enum):
    """Ways to show two images of one view: of a view its render and its photo, or of two runs."""

    RENDER = "render"
    """The render alone; of two runs, that of the first one."""
    OTHER = "photo"
    """The photo alone; of two runs, the render of the second one."""
    WIPE = "wipe"
    """One image: what is left of the line is from the first, the rest from the second."""
    SIDE_BY_SIDE = "side by side"
    """Both beside one another, with the error of a view as the third."""


@dataclass(frozen=True)
class CapturedView:
    """A view of the capture, through whose camera a page looks."""

    split: Split
    index: int


@dataclass(frozen=True)
class ViewState:
    """All that decides what a page shows."""

    pose: Pose = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 1.0)
    width: int = 640
    """Width of the page, in pixels."""
    height: int = 360
    view: CapturedView | None = None
    """The view of the capture that the page looks through; ``None`` while it moves freely."""
    comparison: Comparison = Comparison.RENDER
    wipe: float = 0.5
    """Place of the line of a wipe, in [0, 1] from left to right."""
    time: float = 0.0
    """In [0, 1]; a static model ignores it."""
    channel: str = "color"
    background: Vector | None = None
    """In [0, 1]; ``None`` for the background of the run."""
    splat_scale: float = 1.0
    """Factor of the size of all Gaussians; small ones show where they are."""
    sh_degree: int = MAX_DEGREE
    """Bands of view-dependent colour above this are left out."""
    crop: Box | None = None
    tracks: bool = False
    """Draw the paths of some Gaussians over the last times."""
    behind: float = 0.07
    """Grey of what no image covers: that of the page."""
    full_height: int = 1080
    """Largest height of a frame, in pixels."""

    def full_size(self) -> tuple[int, int]:
        """Width and height of a frame at rest, in the shape of the page."""
        shrunk = min(1.0, self.full_height / max(self.height, 1))
        return max(round(self.width * shrunk), 1), max(round(self.height * shrunk), 1)
