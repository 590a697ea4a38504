"""FinishedModel: a finished run and the views on which its variants are measured."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras, shrunk_to
from gsfw.core.capabilities import Capabilities
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import DataError
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.metrics import is_hidden
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource, is_dynamic
from gsfw.studies.tradeoff.edits import by_motion
from gsfw.studies.tradeoff.subject import Subject

PHOTOS, RENDERS = "photos", "renders of the model as it is"
"""References of the accuracy."""

PROBES = 2
"""Number of views for numerical errors."""
PROBE_SIDE = 160
"""Longer side of their images in pixels: the float64 reference is slow."""


class FinishedModel:
    """A run, the views of its measurement, and the inputs of its variants."""

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
            registry: everything installed.
            name: of the run, for messages.
            views: most held-out views that are used, spread evenly.
            is_model_file: whether it was read from a file of the whole model.

        Raises:
            DataError: none is held out.
        """
        self.restored, self.registry, self.name = restored, registry, name
        self.is_model_file = is_model_file
        data = self.parts.data
        if data.has_images:
            self.views = compared_views(data, Split.EVAL, views, self.device)
        else:
            self.views = evenly(len(data.views(Split.EVAL)), views)
        if not self.views:
            raise DataError(
                f"{name} has no held-out images to measure accuracy on.",
                "Train a run that holds some out: holdout_every=8.",
            )

    @property
    def parts(self) -> TrainingParts:
        """Model, data and rasterizer of the run."""
        return self.restored.composition.parts

    @property
    def device(self) -> torch.device:
        """Device of the run."""
        return self.parts.device

    @cached_property
    def is_still(self) -> bool:
        """True if the model looks the same at every time."""
        return not is_dynamic(self.restored.composition)

    @cached_property
    def source(self) -> RunSource:
        """The run as a source of files, whose contributions are measured once."""
        return RunSource(self.restored)

    @cached_property
    def subject(self) -> Subject:
        """The unchanged model."""
        settings = self.restored.composition.plan.settings
        return Subject(self.parts.model, self.parts.rasterizer, settings, self.is_still)

    @property
    def against(self) -> str:
        """Reference of the accuracy."""
        return PHOTOS if self.parts.data.has_images else RENDERS

    @property
    def rasterizer(self) -> str:
        """Name of the run's rasterizer."""
        return self.restored.composition.settings.choices["rasterizer"].name

    @cached_property
    def able(self) -> dict[str, Capabilities]:
        """Capabilities of every installed rasterizer."""
        return rasterizer_capabilities(self.registry)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the measured views."""
        every = self.parts.data.views(Split.EVAL).names
        return tuple(every[index] for index in self.views)

    @cached_property
    def cameras(self) -> list[Cameras]:
        """Cameras of the measured views."""
        every = self.parts.data.views(Split.EVAL).cameras
        return [every[index].to(self.device) for index in self.views]

    @cached_property
    def probes(self) -> list[Cameras]:
        """Small views for numerical errors."""
        chosen = self.cameras[:: max(1, (len(self.cameras) + 1) // PROBES)][:PROBES]
        return [shrunk_to(camera, PROBE_SIDE) for camera in chosen]

    @cached_property
    def scores(self) -> Float[Tensor, " n"]:
        """Contribution of each Gaussian to the training views."""
        found = self.source.contributions()
        assert found is not None, "variants that need it are offered where it can be measured"
        return found.to(self.device)

    @cached_property
    def by_motion(self) -> Int[Tensor, " n"]:
        """Rows of a moving model, the least motion first."""
        return by_motion(self.subject, self.cameras)

    def fingerprint(self) -> str:
        """Hash of everything that accuracy depends on: parameters, views, and rendering."""
        digest = hashlib.sha256()
        for name, tensor in sorted(self.parts.model.state_dict().items()):
            digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
            digest.update(tensor.detach().cpu().contiguous().flatten().view(torch.uint8).numpy())
        settings = self.subject.settings
        background = settings.background
        rendering = {
            "names": self.names,
            "sizes": [(camera.width, camera.height) for camera in self.cameras],
            "against": self.against,
            "rasterizer": self.rasterizer,
            "device": self.device.type,
            "background": None if background is None else background.tolist(),
            "antialias": settings.antialias,
            "profile": settings.profile.name,
        }
        digest.update(json.dumps(rendering, sort_keys=True).encode())
        return digest.hexdigest()[:16]


def evenly(every: int, most: int) -> list[int]:
    """At most ``most`` of ``every`` places, in the middles of parts of equal length."""
    count = min(most, every)
    return [round((index + 0.5) * every / count - 0.5) for index in range(count)]


def compared_views(data: DataManager, split: Split, most: int, device: torch.device) -> list[int]:
    """At most ``most`` views of a split, spread evenly, but those that masks hide completely.

    Raises:
        DataError: an image does not decode.
    """
    chosen, found = evenly(len(data.views(split)), most), []
    for place, view in enumerate(chosen):
        data.prefetch(split, chosen[place + 1 : place + 3])
        (batch,) = data.load(split, [view], device)
        if not is_hidden(batch.valid):
            found.append(view)
    return found


@dataclass(frozen=True)
class LeftOut:
    """An axis or metric that cannot be measured here, and the reason."""

    axis: str
    why: str
