"""RefinedCapture: a data manager with refined camera poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split, Views, WrappedDataManager
from gsfw.core.loop.pose_refinement import PoseRefinement


class RefinedCapture(WrappedDataManager):
    """Another data manager with refined camera poses, for rendering, comparison and export.

    The scene frame does not change. ``given`` keeps the cameras of the data set.
    """

    def __init__(self, given: DataManager, poses: PoseRefinement) -> None:
        """Refine the cameras of ``given`` by ``poses``."""
        super().__init__(given)
        self._poses = poses

    @torch.no_grad()
    def views(self, split: Split) -> Views:
        """The views of a split with their refined cameras."""
        views = self.given.views(split)
        cameras = [
            self._poses.refine(camera, split, [index]) for index, camera in enumerate(views.cameras)
        ]
        return replace(views, cameras=tuple(cameras))

    @torch.no_grad()
    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Batches with their refined cameras."""
        return [
            replace(batch, cameras=self._poses.refine(batch.cameras, split, batch.views))
            for batch in self.given.load(split, indices, device)
        ]
