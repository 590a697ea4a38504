"""TrainingParts and TrainingPlan: the parts of a run, and its schedule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.corrections import CaptureCorrections
from gsfw.core.loop.distractors import Distractors, is_contradicted
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.resolution import FULL_SIZE, ResolutionSchedule
from gsfw.core.method import Method
from gsfw.core.metrics import Metric, color_corrected
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.returns import checked_decode
from gsfw.core.sampler import Sampler
from gsfw.core.table import SplatTable
from gsfw.core.team import Rendering, Team


@dataclass(frozen=True)
class TrainingPlan:
    """Length and schedule of a run; intervals in steps, 0: only at the end."""

    steps: int
    log_every: int
    eval_every: int
    checkpoint_every: int
    settings: RenderSettings
    """Settings of evaluation; ``Method.render_settings`` may change them for a step."""
    eval_views: int = 0
    """Held-out views of an evaluation in mid-run; 0: all."""
    random_background: bool = False
    max_skipped: int = 20
    prefetch_views: int = 4
    records_steps: bool = False
    """True if steps may be recorded and repeated, where a GPU and all parts can."""
    resolution: ResolutionSchedule = FULL_SIZE
    """Size of training images; evaluation has full images."""
    pace: tuple[str, ...] = ()
    """Recorded decisions on the pace (``core.loop.pace``); empty: one step per update."""
    checks_memory: bool = False
    """True if growth, images and in the end the run give way where main memory runs short."""
    held_back: int = 0
    """Training views that are held back until a decision gives them back."""


@dataclass(frozen=True)
class TrainingParts:
    """The parts of a run; built and checked by ``gsfw.plugins.compose``."""

    method: Method
    model: PrimitiveModel
    optimizer: Optimizer
    table: SplatTable
    refiners: Refiners
    """All refiners, in order: budget, strategy, method."""
    sampler: Sampler
    data: DataManager
    rasterizer: Rasterizer
    operators: Operators
    metrics: Mapping[str, Metric]
    generator: torch.Generator
    device: torch.device
    team: Team = field(default_factory=Team)
    """The processes that train this model."""
    corrections: CaptureCorrections = field(default_factory=CaptureCorrections)
    """Trained corrections of the capture itself, apart from the model; usually none."""
    distractors: Distractors | None = None
    """Finds what other images contradict, and carries no loss; ``None``: all pixels are used."""
    rendered: PrimitiveModel | None = None
    """A model that is rendered in place of it, such as the same with rounded columns; ``None``:
    the model itself."""

    edited: PrimitiveModel | None = None
    """The model as refiners see it, if this process has a part of its rows; ``None``: itself."""

    def render(
        self,
        cameras: Cameras,
        settings: RenderSettings,
        time: Float[Tensor, ""] | None = None,
    ) -> Rendering:
        """Render ``shown`` at ``time``, with decoded images; all processes of the team do."""
        found = self.team.render(self.shown, self.rasterizer, cameras, settings, time)
        source = f"{type(self.shown).__name__}.decode"
        output = checked_decode(source, self.shown.decode(found.output, cameras), len(cameras))
        return replace(found, output=output)

    def leaves_out(self, step: int) -> bool:
        """True if figures after ``step`` steps leave distractors out: none do before the start."""
        return self.distractors is not None and step > self.distractors.start

    def compared(
        self,
        batch: Batch,
        rendered: RenderOutput,
        background: Float[Tensor, " 3"],
        step: int,
        split: Split = Split.TRAIN,
    ) -> Batch:
        """Images for a comparison after ``step`` steps: without distractors (``leaves_out``).

        Args:
            batch: of views at their full size; one if it is held out.
            rendered: the scene, without exposures.
            background: of both.
            step: number of finished steps.
            split: of the images.
        """
        if self.distractors is None or not self.leaves_out(step):
            return batch
        exposed = self._exposed(batch, rendered, background, split)
        return self.distractors.without_some(batch, exposed, batch.target(background))

    def seeks_contradictions(self, split: Split) -> bool:
        """True if the images of a split are searched for things that the model does not have.

        Not in moving scenes, nor if distractors are left out: nothing is to be done. Nor held-out
        images where exposures are trained: theirs are fitted to the image with such things.
        """
        is_lit_as_rendered = split is Split.TRAIN or self.corrections.exposures is None
        still = not self.data.scene.is_dynamic
        return is_lit_as_rendered and still and self.distractors is None

    def contradicts(
        self, batch: Batch, rendered: RenderOutput, background: Float[Tensor, " 3"], split: Split
    ) -> bool:
        """True if an image shows a large thing that the model does not have.

        Args:
            batch: the image, of a split with ``seeks_contradictions``.
            rendered: the scene, without exposures.
            background: of both.
            split: of the image.
        """
        exposed = self._exposed(batch, rendered, background, split)
        return is_contradicted(batch, exposed, batch.target(background))

    def _exposed(
        self, batch: Batch, rendered: RenderOutput, background: Float[Tensor, " 3"], split: Split
    ) -> RenderOutput:
        """The scene with the exposures of the images; those of held-out images are fitted."""
        if split is not Split.TRAIN:
            if self.corrections.exposures is None:
                return rendered
            target, valid = batch.target(background), batch.valid
            color = color_corrected(
                rendered.color[0], target[0], None if valid is None else valid[0]
            )
            return replace(rendered, color=color[None])
        return self.corrections.expose(rendered, self.corrections.numbered(batch), background)

    @property
    def refined(self) -> PrimitiveModel:
        """The model that refiners observe and edit: all its rows."""
        return self.model if self.edited is None else self.edited

    @property
    def shown(self) -> PrimitiveModel:
        """The model that steps and evaluations render."""
        return self.model if self.rendered is None else self.rendered
