"""PoseRefinement: small motions of the training cameras, learnt with the scene.

A camera W, world to camera, takes a point x to exp(r) (W x - p) + p + t. As in BARF (Lin et al.
2021), but with the rotation vector r and the translation t apart, so(3) x R^3, and with the pivot p
on the optical axis at the depth of the scene. A rotation about p hardly moves the image, so that r
and t do not cancel each other, as they do about the camera's centre; CamP (Park et al. 2023)
explains the importance of such coordinates. Measured on the built-in scene, 20 views of 96 x 72,
errors of a degree and 2 % of the extent, 600 steps: 28.8 dB held out, 23.0 dB about the centre.

A common motion of all cameras, equal to a similarity of the world, changes no image once the splats
follow. To first order such motions are the span of seven known directions; every step projects them
out, so that the world keeps the frame of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float, Float64, Int
from torch import Tensor, nn

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.scene import Scene

SMALLEST_DIRECTION = 1e-6
"""Relative singular value of directions that cameras do not have (few, or all on one line)."""


class PoseRefinement(nn.Module):
    """A rotation and a translation for each distinct pose of the training views; zero at first.

    Views with one pose belong to one static camera, and share them.
    """

    depths: Tensor
    """[p]: depths of the pivots, in scene units."""
    rows: Tensor
    """[v]: row of the pose of each training view."""
    common: Tensor
    """[6 p, directions]: an orthonormal basis of the common motions of all cameras."""

    def __init__(self, data: DataManager, learning_rate: LearningRate) -> None:
        """Find the distinct poses, and the directions of their common motions.

        Args:
            data: the capture, with its original poses.
            learning_rate: rate of rotations in radians and of translations in extents.
        """
        super().__init__()
        self.learning_rate = learning_rate
        self.extent = data.scene.extent
        train = data.views(Split.TRAIN).cameras
        numbers: dict[object, int] = {}
        for camera in train:
            numbers.setdefault(_pose(camera), len(numbers))
        self._rows: Mapping[Split, Sequence[int | None]] = {
            split: [numbers.get(_pose(camera)) for camera in data.views(split).cameras]
            for split in Split
        }
        first = {numbers[_pose(camera)]: camera for camera in reversed(train)}
        poses = torch.cat([first[row].world_to_camera for row in range(len(numbers))])
        self.motions = nn.Parameter(torch.zeros(len(numbers), 6))
        """[p, 6]: rotation vectors in radians, translations in extents; in the camera's axes."""
        depths = scene_depths(poses, data.scene)
        common = common_motions(poses.double(), depths.double(), self.extent).float()
        rows = torch.tensor(self._rows[Split.TRAIN], dtype=torch.int64)
        self.register_buffer("rows", rows, persistent=False)
        self.register_buffer("depths", depths, persistent=False)
        self.register_buffer("common", common, persistent=False)

    def group(self) -> ParameterGroup:
        """Parameter group for the optimizer."""
        return ParameterGroup("poses", (self.motions,), self.learning_rate)

    def refine(self, cameras: Cameras, split: Split, views: Sequence[int]) -> Cameras:
        """The refined cameras of some views; held-out poses do not change."""
        like = cameras.world_to_camera
        rows = [self._rows[split][view] for view in views]
        if all(row is None for row in rows):
            return cameras
        motions, depths = self.motions.to(like), self.depths.to(like)
        still = torch.zeros_like(motions[0])
        chosen = torch.stack([still if row is None else motions[row] for row in rows])
        pivots = torch.stack([depths[0 if row is None else row] for row in rows])
        moved = motion_matrices(chosen, pivots, self.extent) @ like
        return replace(cameras, world_to_camera=moved)

    def refine_by_number(self, cameras: Cameras, numbers: Int[Tensor, " c"]) -> Cameras:
        """The refined cameras of training views, by their numbers; the host waits for nothing."""
        like, rows = cameras.world_to_camera, self.rows.index_select(0, numbers)
        motions, pivots = (
            values.index_select(0, rows).to(like) for values in (self.motions, self.depths)
        )
        return replace(
            cameras, world_to_camera=motion_matrices(motions, pivots, self.extent) @ like
        )

    @torch.no_grad()
    def project_(self) -> None:
        """Project out the common motion of all cameras, in place."""
        flat = self.motions.view(-1)
        flat.sub_(self.common @ (self.common.T @ flat))

    @property
    def mean_angle(self) -> float:
        """Mean rotation, in degrees."""
        return float(self.motions.detach()[:, :3].norm(dim=1).mean().rad2deg())

    @property
    def mean_shift(self) -> float:
        """Mean translation, in scene units."""
        return self.extent * float(self.motions.detach()[:, 3:].norm(dim=1).mean())


def _pose(camera: Cameras) -> object:
    return tuple(camera.world_to_camera.flatten().tolist())


def scene_depths(poses: Float[Tensor, "p 4 4"], scene: Scene) -> Float[Tensor, " p"]:
    """Median depth of the points in front of each camera; the extent if there are none."""
    depths = scene.points @ poses[:, 2, :3].T + poses[:, 2, 3]
    if not len(depths):
        return torch.full_like(poses[:, 2, 3], scene.extent)
    found = torch.where(depths > 0, depths, torch.nan).nanmedian(dim=0).values
    return found.nan_to_num(scene.extent)


def motion_matrices(
    motions: Float[Tensor, "c 6"], depths: Float[Tensor, " c"], extent: float
) -> Float[Tensor, "c 4 4"]:
    """Rigid transforms in the cameras' axes: rotate about pivots at ``depths``, then translate."""
    rotation = rotation_vector_matrices(motions[:, :3])
    pivots = torch.stack([torch.zeros_like(depths), torch.zeros_like(depths), depths], dim=1)
    turned = (rotation @ pivots[:, :, None])[..., 0]
    shift = (pivots - turned) + extent * motions[:, 3:]
    top = torch.cat([rotation, shift[:, :, None]], dim=2)
    bottom = top.new_zeros(len(top), 1, 4)
    bottom[:, :, 3].fill_(1.0)  # A number that is assigned would be sent by the host.
    return torch.cat([top, bottom], dim=1)


def common_motions(
    poses: Float64[Tensor, "p 4 4"], depths: Float64[Tensor, " p"], extent: float
) -> Float64[Tensor, "six_p directions"]:
    """An orthonormal basis of the camera motions that equal a motion of the world.

    A world that rotates by w, translates by m and grows by s moves a camera's centre c to
    c + w x c + m + s c, and rotates the camera by -R w, to first order. A rotation r about a
    pivot p adds p x r to the translation.
    """
    rotations = poses[:, :3, :3]
    centers = -(rotations.mT @ poses[:, :3, 3:])[..., 0]
    directions = []
    for axis in torch.eye(3, dtype=torch.float64):
        turned = torch.linalg.cross(axis.expand_as(centers), centers)
        directions.append((-(rotations @ axis), turned))
        directions.append((torch.zeros_like(centers), axis.expand_as(centers)))
    directions.append((torch.zeros_like(centers), centers))
    pivots = depths[:, None] * torch.eye(3, dtype=torch.float64)[2]
    columns = []
    for turn, shift in directions:
        moved = -(rotations @ shift[..., None])[..., 0] - torch.linalg.cross(pivots, turn)
        columns.append(torch.cat([turn, moved / extent], dim=1).flatten())
    basis, sizes, _ = torch.linalg.svd(torch.stack(columns, dim=1), full_matrices=False)
    return basis[:, sizes > SMALLEST_DIRECTION * sizes[0]]
