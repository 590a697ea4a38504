"""Callback: watches a run, and may stop it or ask for a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxtyping import Bool, Float, UInt8
from torch import Tensor

if TYPE_CHECKING:
    from gsfw.core.datamanager import DataManager
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.loop.model_handle import ModelHandle
    from gsfw.core.loop.requirements import Requirements


class Control:
    """Requests of a callback to the trainer; the only influence of a callback on a run."""

    def __init__(self) -> None:
        self.stop_reason: str | None = None
        self.checkpoint_requested = False

    def request_stop(self, reason: str) -> None:
        """End the run after this step, with a checkpoint."""
        self.stop_reason = self.stop_reason or reason

    def request_checkpoint(self) -> None:
        """Write a checkpoint after this step."""
        self.checkpoint_requested = True


@dataclass(frozen=True)
class RunInfo:
    """The facts about a run that are known at its start."""

    folder: Path
    """Folder of the run, which exists; a callback may write files of its own there."""
    method: str
    """Name of the method."""
    scene: str
    """Name of the capture."""
    steps: int
    """Length of the run."""
    first_step: int
    """0, or the step from which a resumed run continues."""
    settings: Mapping[str, Any]
    """Every setting as plain data, by dotted key."""
    protocol: Mapping[str, Any]
    """Measurement protocol of the figures; written into every result file."""
    notes: tuple[str, ...] = ()
    """Notes for the user before training starts."""
    views: int = 0
    """Number of training views; 0 if unknown."""
    model: ModelHandle | None = None
    """The model, for rendering between steps; ``None`` if no trainer made this, or if the rows are
    in several processes."""
    data: DataManager | None = None
    """The images and cameras of the run; ``None`` as for ``model``."""
    step_costs: tuple[tuple[int, float], ...] = ((0, 1.0),)
    """First step, counted from 0, and relative time of a step of each phase of the method."""
    image_stages: tuple[tuple[int, float], ...] = ()
    """First step, counted from 0, and divisor of the sides of the images from there on."""
    view_pixels: int = 0
    """Pixels of a training view at its full size, as a median; 0 if unknown."""


@dataclass(frozen=True)
class TrainingView:
    """The first image of a logged step; must not be changed in place."""

    name: str
    """Name of the image."""
    target: Float[Tensor, "h w 3"]
    """Over the background, on the device of the run, at the size of this step."""
    rendered: Float[Tensor, "h w 3"]
    """Not clamped."""
    left_out: Bool[Tensor, "h w 1"] | None = None
    """True for pixels of a distractor; ``None`` while none are sought."""


@dataclass(frozen=True)
class StepReport:
    """Figures of one logged step (the losses of other steps stay on the device)."""

    step: int
    """Number of finished steps."""
    loss: float
    """Sum of all terms."""
    losses: Mapping[str, float]
    """Each weighted term."""
    psnr: float
    """PSNR of the first image of the step, in dB."""
    num_gaussians: int
    """Rows of the model."""
    learning_rates: Mapping[str, float]
    """Rate of each column and parameter group."""
    step_ms: float
    """Mean wall-clock time of the steps since the last report, in milliseconds."""
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    """Mean wall-clock time by stage: load, render, backward, optimize, refine; in milliseconds."""
    memory_mb: Mapping[str, float] = field(default_factory=dict)
    """Peak memory: "rss" of the process, "cuda" if a GPU is used."""
    skipped_steps: int = 0
    """Number of skipped steps so far; a step is skipped if it is not finite."""
    resolution: float = 1.0
    """Width of the first image of the step over its full width; 1 unless training starts coarse."""
    refined: Mapping[str, int] = field(default_factory=dict)
    """Rows changed since the last report, by verb: {"cloned": 12, "pruned": 3}."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """The method's own figures (``Method.step_metrics``)."""
    view: TrainingView | None = None
    """The first image of the step; ``None`` if no trainer made the report."""
    model: ModelHandle | None = None
    """The model after the step, for rendering from any camera; ``None`` as for ``view``."""


@dataclass(frozen=True)
class EvaluatedView:
    """One held-out image, rendered."""

    name: str
    """Name of the image."""
    metrics: Mapping[str, float]
    """Each metric; NaN for one that failed."""
    target: Float[Tensor, "h w 3"]
    """Over the background, in [0, 1]."""
    rendered: Float[Tensor, "h w 3"]
    """Not clamped."""
    images: Mapping[str, Float[Tensor, "h w 3"]] = field(default_factory=dict)
    """The method's own images of the view, in [0, 1], by name."""


class Callback:
    """Watches a run; every method is optional. No callback may change the training.

    A callback that raises is detached with a warning, and the run continues without it.
    """

    origin: str = ""
    """Registered name and package, for messages; set when the callback is built."""

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Run before the first step."""

    def on_step(self, report: StepReport, control: Control) -> None:
        """Run after each logged step."""

    def on_tick(self, step: int, control: Control) -> None:
        """Run after every step; must be cheap."""

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """Run after each held-out image of an evaluation."""

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Run after each evaluation."""

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Run after a checkpoint is safely on disk."""

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Run after the last step, and after a stopped run."""

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Run after ``on_end``, once the requirements of a completed run are measured."""

    def close(self) -> None:
        """Release files and the screen; called in every case."""
