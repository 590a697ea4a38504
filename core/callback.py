"""Callback: watches a run, and may stop it or ask for a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxtyping import Float, UInt8
from torch import Tensor

if TYPE_CHECKING:
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.loop.requirements import Requirements


class Control:
    """The only way in which a callback may influence a run."""

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
    method: str
    scene: str
    steps: int
    first_step: int
    """0, or the step a resumed run goes on from."""
    settings: Mapping[str, Any]
    """Every setting as plain data, by dotted key."""
    protocol: Mapping[str, Any]
    """How the figures are measured; written into every result file."""
    notes: tuple[str, ...] = ()
    """What the user should know before it starts."""


@dataclass(frozen=True)
class StepReport:
    """One step that was logged (losses stay on the device in all others)."""

    step: int
    """Steps done, counted from 1."""
    loss: float
    losses: Mapping[str, float]
    """Each weighted term."""
    psnr: float
    """Of the first image of the step, in dB."""
    num_gaussians: int
    learning_rates: Mapping[str, float]
    step_ms: float
    """Mean wall-clock time of the steps since the last report, in milliseconds."""
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    """The same by stage: load, render, backward, optimize, refine."""
    memory_mb: Mapping[str, float] = field(default_factory=dict)
    """Peak memory: "rss" of the process, "cuda" where used."""
    skipped_steps: int = 0
    """Steps skipped so far because they were not finite."""
    resolution: float = 1.0
    """Width of the first image of the step over its full width; 1 unless training starts coarse."""
    refined: Mapping[str, int] = field(default_factory=dict)
    """Rows changed since the last report, by verb: {"cloned": 12, "pruned": 3}."""


@dataclass(frozen=True)
class EvaluatedView:
    """One held-out image, rendered."""

    name: str
    metrics: Mapping[str, float]
    target: Float[Tensor, "h w 3"]
    rendered: Float[Tensor, "h w 3"]
    images: Mapping[str, Float[Tensor, "h w 3"]] = field(default_factory=dict)
    """The method's own images of the view, in [0, 1], by name."""


class Callback:
    """Watches a run; every method may be left out. None may change what is trained.

    A callback that raises is detached with a warning, and the run goes on without it.
    """

    origin: str = ""
    """Its registered name and package, for messages; filled in when it is built."""

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Before the first step."""

    def on_step(self, report: StepReport, control: Control) -> None:
        """After a step that is logged."""

    def on_tick(self, step: int, control: Control) -> None:
        """After every step; cheap things only."""

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """After each held-out image of an evaluation."""

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """After an evaluation."""

    def on_checkpoint(self, step: int, path: Path) -> None:
        """After a checkpoint is safely on disk."""

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """After the last step; also when the run was stopped."""

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """After ``on_end``, once the requirements of a completed run were measured."""

    def close(self) -> None:
        """Release files and the screen, whatever happened."""
