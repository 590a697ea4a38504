"""Captures with a few cameras, and captures whose poses or colours were made wrong on purpose."""

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import interpolate, normalize

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.loop.pose_refinement import common_motions, motion_matrices
from gsfw.core.scene import Scene
from support.gaussians import EXTENT
from support.memory_training import camera


def around(index: int) -> Cameras:
    """One of twelve cameras around the scene, every other one higher."""
    higher = torch.eye(4)
    higher[1, 3] = 0.3 * (index % 2)
    level = camera(index, count=12)
    return replace(level, world_to_camera=level.world_to_camera @ higher)


class FewViews(DataManager):
    """Grey images by numbered cameras."""

    def __init__(self, train: Sequence[int] = (0, 1, 2, 3), held: Sequence[int] = (4,)) -> None:
        self.split = {
            Split.TRAIN: Views(
                tuple(f"train_{i}" for i in range(len(train))), tuple(map(around, train))
            ),
            Split.EVAL: Views(
                tuple(f"eval_{i}" for i in range(len(held))), tuple(map(around, held))
            ),
        }

    @property
    def scene(self) -> Scene:
        points = torch.randn(50, 3, generator=torch.Generator().manual_seed(1))
        centers = torch.cat([camera.centers for camera in self.split[Split.TRAIN].cameras])
        return Scene("few", points, torch.full_like(points, 0.5), centers, EXTENT)

    def views(self, split: Split) -> Views:
        return self.split[split]

    def load(self, split, indices, device) -> list[Batch]:
        cameras = Cameras.cat([self.split[split].cameras[index] for index in indices])
        return [Batch(torch.full((len(indices), 24, 32, 3), 0.5), cameras, tuple(indices))]


def wrong_motions(data: DataManager, degrees: float, extents: float) -> Tensor:
    """Random motions of the training cameras about their centres; together they go nowhere."""
    poses = torch.cat([camera.world_to_camera for camera in data.views(Split.TRAIN).cameras])
    generator = torch.Generator().manual_seed(3)
    turns, shifts = (normalize(torch.randn(len(poses), 3, generator=generator)) for _ in range(2))
    motions = torch.cat([math.radians(degrees) * turns, extents * shifts], dim=1).flatten()
    depths = torch.zeros(len(poses), dtype=torch.float64)
    basis = common_motions(poses.double(), depths, data.scene.extent).float()
    return (motions - basis @ (basis.T @ motions)).view(-1, 6)


class WrongCapture(DataManager):
    """A capture whose training cameras stand elsewhere, or whose training images are tinted."""

    def __init__(
        self, given: DataManager, motions: Tensor | None = None, tones: Tensor | None = None
    ) -> None:
        """``tones``: gains of each training image, [v, rows, columns, 1 or 3], enlarged to it."""
        self.given, self.motions, self.tones = given, motions, tones

    @property
    def scene(self) -> Scene:
        return self.given.scene

    def views(self, split: Split) -> Views:
        views = self.given.views(split)
        cameras = [self._moved(camera, split, [i]) for i, camera in enumerate(views.cameras)]
        return replace(views, cameras=tuple(cameras))

    def load(self, split, indices, device) -> list[Batch]:
        return [self._wrong(batch, split) for batch in self.given.load(split, indices, device)]

    def _wrong(self, batch: Batch, split: Split) -> Batch:
        views = list(batch.views)
        batch = replace(batch, cameras=self._moved(batch.cameras, split, views))
        if self.tones is None or split is Split.EVAL:
            return batch
        coarse, size = self.tones[views].movedim(-1, 1), batch.images.shape[1:3]
        tones = interpolate(coarse, size, mode="bilinear", align_corners=True).movedim(1, -1)
        return replace(batch, images=batch.images * tones)

    def _moved(self, cameras: Cameras, split: Split, views: list[int]) -> Cameras:
        if self.motions is None or split is Split.EVAL:
            return cameras
        moves = motion_matrices(self.motions[views], torch.zeros(len(views)), self.scene.extent)
        return replace(cameras, world_to_camera=moves @ cameras.world_to_camera)
