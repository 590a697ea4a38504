"""RefinedCapture: a capture seen from cameras that are being refined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.loop.pose_refinement import PoseRefinement
from gsfw.core.scene import Scene


class RefinedCapture(DataManager):
    """Another data manager, whose cameras stand where they have been refined to.

    Cameras of batches have a gradient; whoever draws, compares or exports sees refined ones.
    """

    def __init__(self, given: DataManager, poses: PoseRefinement) -> None:
        """Refine the cameras of ``given`` by ``poses``."""
        self.given = given
        """The capture with the cameras that the data set has."""
        self._poses = poses
        self.has_pictures = given.has_pictures  # type: ignore[misc]

    @property
    def scene(self) -> Scene:
        """As it was given: the frame of the scene stays where it is."""
        return self.given.scene

    @torch.no_grad()
    def views(self, split: Split) -> Views:
        """The views of a split with their refined cameras."""
        views = self.given.views(split)
        cameras = [
            self._poses.refine(camera, split, [index]) for index, camera in enumerate(views.cameras)
        ]
        return replace(views, cameras=tuple(cameras))

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Batches whose cameras have a gradient where gradients are on."""
        return [
            replace(batch, cameras=self._poses.refine(batch.cameras, split, batch.views))
            for batch in self.given.load(split, indices, device)
        ]

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """As the capture has it."""
        return self.given.moving_mask(split, index)

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start decoding."""
        self.given.prefetch(split, indices)

    def notes(self) -> tuple[str, ...]:
        """Those of the capture."""
        return self.given.notes()

    def close(self) -> None:
        """Stop background work and free the pictures."""
        self.given.close()
