"""ViewedModel: a model and all that is needed to show it, of a run or of a file."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.maths.similarity import Similarity
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import is_dynamic
from gsfw.viewer.view_state import CapturedView

SAME_PLACE = 0.01
"""Largest shift of a camera between two runs, relative to the scene: poses may be refined."""


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
    data: DataManager
    """Cameras and photos of the capture."""
    is_dynamic: bool = False
    """True if the model changes with time."""
    has_cameras: bool = True
    """False if nobody stood at the cameras of the data: they are only to look from."""
    subject: str = ""
    """Method and scene of a run, such as "3dgs on fox"; empty for a file."""

    @staticmethod
    def of(name: str, restored: Restored, has_cameras: bool, subject: str = "") -> ViewedModel:
        """The model of an opened run or file; see the fields."""
        composition = restored.composition
        parts = composition.parts
        return ViewedModel(
            name=name,
            model=parts.model,
            rasterizer=parts.rasterizer,
            settings=composition.plan.settings,
            scene=composition.scene,
            device=parts.device,
            data=parts.data,
            is_dynamic=is_dynamic(composition),
            has_cameras=has_cameras,
            subject=subject,
        )

    def captured(self) -> list[CapturedView]:
        """All views of the capture, those to train on first."""
        if not self.has_cameras:
            return []
        splits = (Split.TRAIN, Split.EVAL)
        return [
            CapturedView(split, index)
            for split in splits
            for index in range(len(self.data.views(split)))
        ]

    def camera(self, view: CapturedView) -> Cameras:
        """The camera of a captured view."""
        return self.data.views(view.split).cameras[view.index]

    def view_name(self, view: CapturedView) -> str:
        """Name of a captured view, unique among all of them."""
        name = self.data.views(view.split).names[view.index]
        return name if view.split is Split.TRAIN else f"{name} (held out)"

    @property
    def has_photos(self) -> bool:
        """True if the views have images to compare with."""
        return self.data.has_images

    def batch(self, view: CapturedView) -> Batch:
        """The photo of a captured view, and its camera, on the device.

        Raises:
            DataError: the image does not decode.
        """
        (batch,) = self.data.load(view.split, [view.index], self.device)
        return batch


def between(source: ViewedModel, target: ViewedModel) -> Similarity:
    """Leads from the scene frame of one model to that of another, by the world of the data."""
    world, back = source.scene.world_from_scene, target.scene.world_from_scene.inverse()
    return Similarity(
        back.scale * world.scale,
        back.rotation @ world.rotation,
        back.apply(world.translation),
    )


def same_world(first: ViewedModel, second: ViewedModel) -> bool:
    """True if two models have a view in common, at one place of one world."""
    where = _centers(second)
    for name, center in _centers(first).items():
        if name in where:
            apart = float((center - where[name]).norm())
            return apart < SAME_PLACE * first.scene.extent * first.scene.world_from_scene.scale
    return False


def _centers(model: ViewedModel) -> dict[str, torch.Tensor]:
    """Centres of the cameras by view, in the world of the data."""
    world = model.scene.world_from_scene
    return {
        name: world.apply(camera.centers[0].detach().cpu())
        for split in (Split.TRAIN, Split.EVAL)
        if model.has_cameras
        for name, camera in zip(
            model.data.views(split).names, model.data.views(split).cameras, strict=True
        )
    }
