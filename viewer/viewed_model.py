"""ViewedModel: a model and all that is needed to show it, of a run or of a file."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.viewer.view_state import CapturedView


@dataclass(frozen=True)
class ViewedModel:
    """A model and all that is needed to show it."""

    name: str
    """Name of the run or file, for the page."""
    model: PrimitiveModel
    rasterizer: Rasterizer
    settings: RenderSettings
    """Settings of the evaluation; with a background."""
    scene: Scene
    device: torch.device
    data: DataManager | None = None
    """Cameras and photos of the capture; ``None`` for a file that has none."""
    is_dynamic: bool = False
    """True if the model changes with time."""

    def captured(self) -> list[CapturedView]:
        """All views of the capture, those to train on first."""
        if self.data is None:
            return []
        splits = (Split.TRAIN, Split.EVAL)
        return [
            CapturedView(split, index)
            for split in splits
            for index in range(len(self.data.views(split)))
        ]

    def camera(self, view: CapturedView) -> Cameras:
        """The camera of a captured view."""
        assert self.data is not None
        return self.data.views(view.split).cameras[view.index]

    def view_name(self, view: CapturedView) -> str:
        """Name of a captured view, unique among all of them."""
        assert self.data is not None
        name = self.data.views(view.split).names[view.index]
        return name if view.split is Split.TRAIN else f"{name} (held out)"

    @property
    def has_photos(self) -> bool:
        """True if the views have images to compare with."""
        return self.data is not None and self.data.has_images

    def batch(self, view: CapturedView) -> Batch:
        """The photo of a captured view, and its camera, on the device.

        Raises:
            DataError: the image does not decode.
        """
        assert self.data is not None
        (batch,) = self.data.load(view.split, [view.index], self.device)
        return batch

    def captured_times(self) -> tuple[float, ...]:
        """All times of the capture in [0, 1], ascending; none for a static one."""
        if self.data is None:
            return ()
        times = {time for split in Split for time in self.data.views(split).times or ()}
        return tuple(sorted(times))
