"""Team: the processes that train one model; usually one.

The loop calls a team at each point where processes have to agree. ``gsfw.parallel`` has the teams
of several processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.context import StepContext
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.returns import splats_to_render
from gsfw.core.splats import Splats

if TYPE_CHECKING:
    from gsfw.core.loop.forward import RenderedBatch
    from gsfw.core.loop.optimizer import Optimizer
    from gsfw.core.loop.training_parts import TrainingParts
    from gsfw.core.refinement.refiners import Refiners
    from gsfw.core.table import SplatTable

Value = TypeVar("Value")


@dataclass(frozen=True)
class RenderedPart:
    """Rows of a model in one render: all of them, or a part of those of this process."""

    splats: Splats
    """Splats of the rows, attached to the graph."""
    statistics: RenderStatistics
    """Statistics of the rows; empty before the backward pass if other processes measure them."""
    share: float = 1.0
    """Fraction of all rows of the model."""
    shown: Callable[[], AbstractContextManager[None]] = nullcontext
    """Within this context the model has these rows alone."""


@dataclass(frozen=True)
class Rendering:
    """The images of a render, and the parts of the model in it."""

    output: RenderOutput
    splats: Splats
    """All splats; they cannot be read if other processes have some of them."""
    parts: Sequence[RenderedPart]


@dataclass(frozen=True)
class Observation:
    """A rendered batch of a step, for refiners and samplers."""

    context: StepContext
    """Its context; one without splats if another process has rendered the batch."""
    statistics: RenderStatistics
    """Its statistics, with the gradients of the backward pass. They are of all rows if a refiner
    observes."""
    data_loss: Tensor
    """Sum of the terms that compare with the images."""


class Team:
    """One process that trains alone, and the interface of teams of several.

    All processes of a team call its methods in the same order.
    """

    size: int = 1
    """Number of processes."""
    rank: int = 0
    """Number of this process, from 0."""
    splits_views: bool = False
    """True if each view of a step is a batch of its own."""

    @property
    def leads(self) -> bool:
        """True for the one process that logs, evaluates and writes files."""
        return self.rank == 0

    def check(self, parts: TrainingParts) -> None:
        """Check that the parts of a run work with these processes, and are alike in all of them.

        Raises:
            ConfigError: one does not; names it.
        """

    def share(self, parts: TrainingParts) -> TrainingParts:
        """The parts of a run as this process has them, such as some of the rows."""
        return replace(parts, team=self)

    def stops(self, wanted: bool, table: SplatTable, generator: torch.Generator) -> bool:
        """True if any process wants to stop; called before every step.

        Args:
            wanted: true if this process wants to stop.
            table: rows of this process, which are compared with those of the others.
            generator: random numbers of this process, which are compared too.

        Raises:
            TrainingError: refiners have edited rows in different ways.
        """
        return wanted

    def own(self, views: tuple[int, ...]) -> tuple[int, ...]:
        """The views of a step that this process renders."""
        return views

    def render(
        self,
        model: PrimitiveModel,
        rasterizer: Rasterizer,
        cameras: Cameras,
        settings: RenderSettings,
        time: Float[Tensor, ""] | None,
    ) -> Rendering:
        """Render a model at ``time``; its images are not decoded."""
        splats = splats_to_render(model, time, cameras)
        output = rasterizer.render(splats, cameras, settings)
        return Rendering(output, splats, [RenderedPart(splats, output.statistics)])

    def rounds(
        self, batches: Sequence[Batch], views: tuple[int, ...]
    ) -> Iterator[tuple[int, Batch | None]]:
        """The batches of this process, with their places among all batches of the step.

        Args:
            batches: batches of the views of ``own``.
            views: all views of the step.

        Yields:
            A batch for each round, or ``None`` if only other processes have one.
        """
        yield from enumerate(batches)

    def backward(self, rendered: RenderedBatch | None, optimizer: Optimizer) -> None:
        """Run the backward pass of a round; gradients add up over the rounds of a step."""
        if rendered is not None:
            rendered.total.backward()

    def finish(self, rendered: Sequence[RenderedBatch], optimizer: Optimizer) -> list[Tensor]:
        """Complete the gradients of a step; return the losses of all batches."""
        return [item.total.detach() for item in rendered]

    def agreed(self, finite: Bool[Tensor, ""]) -> Bool[Tensor, ""]:
        """True if it is so in all processes; called once in every step."""
        return finite

    def observations(
        self,
        rendered: Sequence[RenderedBatch],
        refiners: Refiners,
        absent: Callable[[int], StepContext],
    ) -> Iterator[Observation]:
        """All batches of a step in order.

        Args:
            rendered: batches of this process, after their backward pass.
            refiners: they decide what is needed of the batches of other processes.
            absent: returns the context of a view that another process has rendered.
        """
        for item in rendered:
            statistics = item.context.rendered.statistics
            yield Observation(item.context, statistics, item.data_loss.detach())

    def visible(self, visible: Bool[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """Rows that any process has seen."""
        return visible

    def whole(
        self, state: dict[str, Any], parts: TrainingParts, folder: Path
    ) -> dict[str, Any] | None:
        """The state of a run with all rows of its model.

        Args:
            state: of this process.
            parts: of this process.
            folder: the folder of the run; rows of other processes may be kept in it.

        Returns:
            The state for a checkpoint; ``None`` in processes that write none.
        """
        return state if self.leads else None

    def meets_again(self, standing: object) -> bool:
        """Connect the processes anew after an error in any of them, to write their state together.

        Called once by every process that can, if they share the rendering.

        Args:
            standing: comparable position of this process in the run; ``None`` if it has no state to
                write.

        Returns:
            True if every process has the same standing, and a state.

        Raises:
            LostProcessError: a process has ended.
        """
        return False

    def own_state(self, state: Mapping[str, Any], parts: TrainingParts) -> Mapping[str, Any]:
        """The state of this process, from that of a checkpoint."""
        return state

    def reunited(self, parts: TrainingParts, folder: Path) -> TrainingParts:
        """The parts of a run that has ended, with all rows in the first process.

        Args:
            parts: of this process.
            folder: the folder of the run; rows of other processes may be kept in it.
        """
        return parts

    def gathered(self, value: Value) -> list[Value]:
        """A value of each process, in order of rank; plain data."""
        return [value]

    @property
    def shares_rendering(self) -> bool:
        """True if a process has not all rows: all processes render and evaluate together then."""
        return False

    @property
    def evaluates(self) -> bool:
        """True if this process evaluates and gathers checkpoints: the first one, or all."""
        return self.leads or self.shares_rendering

    def summary(self) -> Mapping[str, int]:
        """Figures for the run's summary; empty for one process."""
        return {}


ALONE = Team()
"""The team of a process that trains alone."""
