"""StoredCapture: a capture with cameras only, from a model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.errors import DataError
from gsfw.core.scene import Scene
from gsfw.core.words import shell_argument


class StoredCapture(DataManager):
    """Cameras without images: enough to render a model, not to compare it."""

    has_images = False

    def __init__(
        self, scene: Scene, views: Mapping[Split, Views], source: str, has_data: bool = True
    ) -> None:
        """Store the content of a file.

        Args:
            scene: scene of the capture.
            views: views of every split.
            source: the file, for messages.
            has_data: true if the images came from a data set; false if the run generated them, as
                for the built-in scene.
        """
        self._scene, self._views, self._source = scene, views, source
        self._has_data = has_data

    @property
    def scene(self) -> Scene:
        """The scene of the training, without its points."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The cameras of a split, by image name."""
        return self._views[split]

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Raise an error: there are no images.

        Raises:
            DataError: always; names the alternatives.
        """
        where = "Add data=PATH with the data set it was trained on"
        if not self._has_data:
            where = "It was trained on the built-in scene, not on a data set: give the run's folder"
        raise DataError(
            f"{self._source} contains no images, only the cameras that took them.",
            f"{where}, or render what needs no images: "
            f"gsfw render {shell_argument(self._source)} what=orbit",
        )
