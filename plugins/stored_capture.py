"""StoredCapture: a capture of which only the cameras are left, as a model file keeps them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.errors import DataError
from gsfw.core.scene import Scene


class StoredCapture(DataManager):
    """Cameras without pictures: enough to draw a model, not to compare it with anything."""

    has_images = False

    def __init__(
        self, scene: Scene, views: Mapping[Split, Views], source: str, has_data: bool = True
    ) -> None:
        """Take what a file holds.

        Args:
            scene: of the capture.
            views: of every split.
            source: the file, for messages.
            has_data: whether the pictures were those of a data set, which is somewhere; else the
                run made them itself, as it does those of the built-in scene.
        """
        self._scene, self._views, self._source = scene, views, source
        self._has_data = has_data

    @property
    def scene(self) -> Scene:
        """As it was in training, without its points."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The cameras of a split, by the names of their pictures."""
        return self._views[split]

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """There is nothing to decode.

        Raises:
            DataError: always; says what can be done without pictures.
        """
        where = "Add data=PATH with the data set it was trained on"
        if not self._has_data:
            where = "It was trained on the built-in scene, not on a data set: give the run's folder"
        raise DataError(
            f"{self._source} holds no pictures, only the cameras that took them.",
            f"{where}, or draw what needs no pictures: gsfw render {self._source} what=orbit",
        )
