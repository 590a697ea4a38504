"""FinishedModel: a run that is taken for measuring, and the views it is measured on."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Capabilities
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.compose import Composition
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.studies.tradeoff.contribution import contributions
from gsfw.studies.tradeoff.edits import by_motion
from gsfw.studies.tradeoff.subject import Subject

PHOTOS, RENDERS = "photos", "renders of the model as it is"
"""What accuracy is measured against."""

PROBES = 2
"""Views on which errors of numbers are measured."""
PROBE_SIDE = 160
"""Longer side of their pictures, in pixels: the reference in float64 takes its time."""


class FinishedModel:
    """A run, the views it is measured on, and what variants are made of."""

    def __init__(
        self,
        restored: Restored,
        registry: Registry,
        name: str,
        views: int,
        is_model_file: bool = False,
    ) -> None:
        """Choose the views.

        Args:
            restored: the run.
            registry: what is installed.
            name: of the run, for messages.
            views: most held-out views that are used, spread evenly.
            is_model_file: whether it was read from a file of the whole model.

        Raises:
            DataError: none is held out.
        """
        self.restored, self.registry, self.name = restored, registry, name
        self.is_model_file = is_model_file
        every = len(self.parts.data.views(Split.EVAL))
        if not every:
            raise DataError(
                f"{name} has no held-out pictures to measure accuracy on.",
                "Train a run that holds some out: holdout_every=8.",
            )
        self.views = evenly(every, views)

    @property
    def parts(self) -> TrainingParts:
        """What the run is made of."""
        return self.restored.composition.parts

    @property
    def device(self) -> torch.device:
        """Where it is drawn."""
        return self.parts.device

    @cached_property
    def is_still(self) -> bool:
        """Whether the model looks the same at every time."""
        return is_still(self.restored.composition)

    @cached_property
    def subject(self) -> Subject:
        """The model as it is."""
        settings = self.restored.composition.plan.settings
        return Subject(self.parts.model, self.parts.rasterizer, settings, self.is_still)

    @property
    def against(self) -> str:
        """What accuracy is measured against."""
        return PHOTOS if self.parts.data.has_pictures else RENDERS

    @property
    def rasterizer(self) -> str:
        """Name of the run's rasterizer."""
        return self.restored.composition.settings.choices["rasterizer"].name

    @cached_property
    def able(self) -> dict[str, Capabilities]:
        """What every installed rasterizer can do."""
        return rasterizer_capabilities(self.registry)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the views that it is measured on."""
        every = self.parts.data.views(Split.EVAL).names
        return tuple(every[index] for index in self.views)

    @cached_property
    def cameras(self) -> list[Cameras]:
        """Of the same views."""
        every = self.parts.data.views(Split.EVAL).cameras
        return [every[index].to(self.device) for index in self.views]

    @cached_property
    def probes(self) -> list[Cameras]:
        """Small views on which errors of numbers are measured."""
        chosen = self.cameras[:: max(1, (len(self.cameras) + 1) // PROBES)][:PROBES]
        return [_small(camera) for camera in chosen]

    @cached_property
    def scores(self) -> Float[Tensor, " n"]:
        """How much each Gaussian adds to the training views."""
        return contributions(self.subject, self.parts.data.views(Split.TRAIN).cameras)

    @cached_property
    def by_motion(self) -> Int[Tensor, " n"]:
        """Rows of a model that moves, those that move least first."""
        return by_motion(self.subject)

    def fingerprint(self) -> str:
        """Of all that accuracy depends on: the parameters, the views, and how they are drawn."""
        digest = hashlib.sha256()
        for name, tensor in sorted(self.parts.model.state_dict().items()):
            digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
            digest.update(tensor.detach().cpu().contiguous().flatten().view(torch.uint8).numpy())
        settings = self.subject.settings
        background = settings.background
        drawn = {
            "names": self.names,
            "sizes": [(camera.width, camera.height) for camera in self.cameras],
            "against": self.against,
            "rasterizer": self.rasterizer,
            "device": self.device.type,
            "background": None if background is None else background.tolist(),
            "antialias": settings.antialias,
            "profile": settings.profile.name,
        }
        digest.update(json.dumps(drawn, sort_keys=True).encode())
        return digest.hexdigest()[:16]


def evenly(every: int, most: int) -> list[int]:
    """Places of at most so many of all, in the middles of parts of equal length."""
    count = min(most, every)
    return [round((index + 0.5) * every / count - 0.5) for index in range(count)]


def is_still(composition: Composition) -> bool:
    """Whether a model looks the same at every time."""
    return not composition.scene.is_dynamic or "static" in composition.settings.method.tags


def _small(camera: Cameras) -> Cameras:
    """The same view with at most ``PROBE_SIDE`` pixels along its longer side."""
    factor = min(1.0, PROBE_SIDE / max(camera.width, camera.height))
    size = (max(1, round(side * factor)) for side in (camera.width, camera.height))
    return camera.resized(*size)


@dataclass(frozen=True)
class LeftOut:
    """Something that was asked for and cannot be measured here."""

    axis: str
    why: str
