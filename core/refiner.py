"""Refiner: edits the rows of a model while it is trained."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, Statistic
from gsfw.core.table import SplatTable

Refinement = Mapping[str, int]
"""The edits of a refiner, by verb: {"cloned": 12, "pruned": 3}; empty when it edited nothing."""

RESET = "reset"
"""The verb of a refiner that lowers all opacities on purpose, so that they have to recover."""


@dataclass(frozen=True)
class GrowthLimits:
    """Limits that a refiner sets for all others, such as those of a budget."""

    may_grow: bool = True
    """False once no refiner may add rows or reset opacities."""
    hold: bool = False
    """True while no refiner may add or remove rows, since statistics by row are gathered."""
    max_rows: int | None = None
    """Most rows while the model grows; ``None`` for no limit."""

    def __and__(self, other: GrowthLimits) -> GrowthLimits:
        """Both limits at once."""
        known = [limit for limit in (self.max_rows, other.max_rows) if limit is not None]
        return GrowthLimits(
            self.may_grow and other.may_grow, self.hold or other.hold, min(known, default=None)
        )

    def most_rows(self, own: int = 0) -> int:
        """The smaller of ``max_rows`` and a refiner's own limit; 0 for no limit."""
        return own if self.max_rows is None else min(self.max_rows, own or self.max_rows)

    def room(self, rows: int, wanted: int, own: int = 0) -> int:
        """Number of rows that may be added now.

        Args:
            rows: rows there are.
            wanted: rows that a refiner would add.
            own: the refiner's own limit of rows; 0 for none.
        """
        if self.hold or not self.may_grow:
            return 0
        most = self.most_rows(own)
        return min(wanted, max(most - rows, 0)) if most > 0 else wanted


@dataclass(frozen=True)
class RefineContext:
    """The state of a run after an optimizer step, for the refiners to edit."""

    step: int
    """The latest step, counted from 0."""
    steps: int
    """Length of the run."""
    table: SplatTable
    """Adds, removes and replaces rows, with their optimizer moments."""
    model: PrimitiveModel
    """The model of the table; makes new rows (``clone_rows``, ``split_rows``)."""
    generator: torch.Generator
    """The only source of randomness, on the model's device."""
    limits: GrowthLimits
    """Current limits of all refiners."""
    growth_due: bool
    """True if any refiner adds rows after this step (``Refiner.growth_due``)."""
    edits: Refinement
    """Edits of earlier refiners in the same step."""
    operators: Operators = field(default_factory=Operators)
    """Operators of the model's device; plain torch runs on all."""

    @property
    def done(self) -> int:
        """Number of finished steps."""
        return self.step + 1


class Refiner(ABC):
    """Edits rows: density control, budgets, spherical-harmonic bands, motion of single rows.

    A run has an ordered list of refiners: the budget, those of the strategy, those of the method.
    All batches of a step are rendered before any is observed. The order of calls in a step is
    ``needs_view_gradients``; for each batch ``depth``, ``statistics``, ``regularizers`` and
    ``before_backward``; after the optimizer step, for each batch, ``observe``; then ``refine``.
    In a run that has to end in a time (minutes=, until=) an update may stand for several steps of
    the schedule, or for none: ``refine`` then is called for each of these steps, in order.

    Only ``refine`` is required, and a ``name``.
    """

    name: ClassVar[str]
    """Unique among the refiners of a run; the key of its state in checkpoints."""
    reads_images: ClassVar[bool] = True
    """False if ``observe`` reads statistics, views and shares alone. In a training with several
    processes the images of the others are then not sent to this one."""

    divisible: ClassVar[bool] = True
    """False if it reads more of the model than ``DensifiableModel`` has, such as columns: the rows
    then cannot be divided among processes (shards=N)."""

    def statistics(self, step: int) -> frozenset[Statistic]:
        """Statistics to measure at ``step``; none once they are no longer needed."""
        return frozenset()

    def depth(self, step: int) -> Depth:
        """The depth image to render at ``step``, for ``observe``."""
        return Depth.NONE

    def needs_view_gradients(self, step: int) -> bool:
        """True if the gradients of single views are needed: each view is then its own batch.

        The loss of a step with several views stays the mean over them.
        """
        return False

    def can_be_recorded(self, step: int) -> bool:
        """True if a step with this refiner's own work may be recorded on a GPU and repeated.

        The answer covers ``regularizers``, ``before_backward`` and its hooks. At all steps with the
        answer true they launch the same work, on the batch, the parameters and the model's rows:
        they read no other changing state, keep nothing on the host, and neither wait for the GPU
        nor move anything to it. A derived class with another ``regularizers`` or
        ``before_backward`` needs its own answer; a refiner with neither needs none.
        """
        return True

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Weighted scalars to add to the loss of a batch, by name. No side effects."""
        return {}

    def before_backward(self, context: StepContext, model: PrimitiveModel) -> None:  # noqa: B027
        """Attach hooks to tensors of the graph of a batch, once its losses are known."""

    def observe(  # noqa: B027
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Gather statistics of a batch, after the optimizer step.

        Statistics come in the order of the rendered splats: ``RowStatistics`` adds them up by
        row. Those of a step that was not finite are zero. The model still has the gradients of
        the whole step (``time_gradients``).
        """

    def growth_due(self, step: int) -> bool:
        """True if ``refine`` adds rows after ``step``, provided the limits allow it."""
        return False

    @property
    def growth_ends(self) -> int | None:
        """Steps after which ``refine`` adds no more rows; ``None`` if it never ends."""
        return None

    def reset_due(self, step: int) -> bool:
        """True if ``refine`` resets opacities after ``step``, provided the limits allow it."""
        return False

    def limits(self, step: int, model: PrimitiveModel) -> GrowthLimits:
        """Limits for all refiners after ``step``."""
        return GrowthLimits()

    @abstractmethod
    def refine(self, context: RefineContext) -> Refinement:
        """Edit rows if the schedule says so. Called after every step of the schedule."""

    def rows_edited(self) -> None:  # noqa: B027
        """Drop statistics by row: a refiner has added, removed or replaced rows."""

    def opacities_reset(self, step: int) -> None:  # noqa: B027
        """Expect higher losses for some time: a refiner has reset opacities after ``step``."""

    def report(self) -> Mapping[str, Any]:
        """Results for ``requirements.json`` of the finished run, as plain data."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:  # noqa: B027
        """Continue from ``state``."""
