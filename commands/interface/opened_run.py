"""OpenedRun: a finished run for verbs and programs: its data, its model, and renders of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.commands.interface import runs
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager
from gsfw.core.loop.evaluation import render_model
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene


@dataclass(frozen=True)
class OpenedRun:
    """A run at one of its checkpoints, or a model file, on the device of the run."""

    name: str
    """Path of the run or file."""
    step: int
    """Number of finished steps."""
    settings: Mapping[str, Any]
    """Every setting as plain data, by dotted key."""
    data: DataManager
    """Scene, views and images. A model file has no images, unless ``data`` was given."""
    method: Method
    """The method, as built."""
    model: PrimitiveModel
    """The model, with the state of the checkpoint."""
    rasterizer: Rasterizer
    """The rasterizer of the run, or the one that fits ``device``."""
    render_settings: RenderSettings
    """Settings of an evaluation of the run, with its background."""
    device: torch.device
    """Device of the model, for ``data.load`` and cameras."""

    @property
    def scene(self) -> Scene:
        """The facts about the capture."""
        return self.data.scene

    def render(self, cameras: Cameras, time: Float[Tensor, ""] | None = None) -> RenderOutput:
        """Render the model from cameras in the scene frame, without gradients.

        Args:
            cameras: on ``device``, as those of a batch from ``data.load`` are.
            time: in [0, 1], as ``batch.time``; ``None`` for a static capture.
        """
        return render_model(self.model, self.rasterizer, cameras, self.render_settings, time)


def open_run(
    run: str | Path, data: str = "", device: str = "", step: int | None = None
) -> OpenedRun:
    """Open a run for rendering; a verb passes the fields of its ``RunOptions``.

    Args:
        run: a run folder, a checkpoint, a model file (.gsfw), or "latest".
        data: place of the data set; empty for its place in training.
        device: auto, cpu, cuda or cuda:N; empty for that of the training.
        step: step of the checkpoint; ``None`` for that of ``run``, or else the latest.

    Raises:
        DataError: there is no such run or checkpoint, its data is gone, or a file is damaged.
        ConfigError: its settings no longer resolve: a plugin is missing, for instance.
    """
    from gsfw.commands.interface.arguments import changed_place
    from gsfw.plugins.registry import installed

    found = runs.find_run(str(run), lambda _: None)
    restored = runs.restore_run(found, installed(), changed_place(data, device), step)
    parts = restored.composition.parts
    return OpenedRun(
        name=found.name,
        step=restored.step,
        settings=restored.composition.settings.flat(),
        data=parts.data,
        method=parts.method,
        model=parts.model,
        rasterizer=parts.rasterizer,
        render_settings=restored.composition.plan.settings,
        device=parts.device,
    )
