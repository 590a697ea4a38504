"""Refiners: the ordered list of all refiners of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from operator import and_
from typing import Any

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.part_state import load_part, state_of
from gsfw.core.refiner import RESET, GrowthLimits, RefineContext, Refinement, Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, Statistic
from gsfw.core.returns import checked_mapping, checked_terms
from gsfw.core.table import SplatTable


def checked_refiners(source: str, found: object) -> tuple[Refiner, ...]:
    """The refiners that a part returned.

    Raises:
        ConfigError: they are no sequence of named refiners.
    """
    if not isinstance(found, Sequence):
        raise ConfigError(
            f"{source} returned {type(found).__name__}, expected a tuple of refiners.",
            "Return a tuple, such as (refiner,); () if there is none.",
        )
    for refiner in found:
        if not isinstance(refiner, Refiner):
            raise ConfigError(
                f"{source} returned {type(refiner).__name__} among its refiners.",
                "Derive its class from gsfw.api.Refiner.",
            )
        if not isinstance(getattr(refiner, "name", None), str):
            raise ConfigError(
                f"the refiner {type(refiner).__name__} has no name.",
                'Write name = "..." in its class: the key of its state in checkpoints.',
            )
    return tuple(found)


class Refiners:
    """Calls every refiner in order, and passes limits and notices between them."""

    def __init__(self, refiners: Sequence[Refiner] = ()) -> None:
        """Store the refiners in the order in which they edit rows.

        Raises:
            ConfigError: two have the same name.
        """
        self._refiners = tuple(refiners)
        for name, count in Counter(refiner.name for refiner in refiners).items():
            if count > 1:
                raise ConfigError(
                    f"{count} refiners of this run are named {name!r}.",
                    "The name of a refiner is the key of its state: give each its own.",
                )

    def __iter__(self) -> Iterator[Refiner]:
        return iter(self._refiners)

    def statistics(self, step: int) -> frozenset[Statistic]:
        """Statistics that any refiner needs at ``step``."""
        return frozenset().union(*(refiner.statistics(step) for refiner in self))

    def depth(self, step: int) -> Depth:
        """The depth image that the refiners need at ``step``.

        Raises:
            ConfigError: two refiners need different ones.
        """
        wanted = {refiner.depth(step) for refiner in self} - {Depth.NONE}
        if len(wanted) > 1:
            names = ", ".join(r.name for r in self if r.depth(step) is not Depth.NONE)
            raise ConfigError(f"the refiners {names} need different depth images at step {step}.")
        return wanted.pop() if wanted else Depth.NONE

    @property
    def observes(self) -> bool:
        """True if any refiner gathers statistics of batches."""
        return any(type(refiner).observe is not Refiner.observe for refiner in self)

    def needs_view_gradients(self, step: int) -> bool:
        """True if any refiner needs the gradients of single views at ``step``."""
        return any(refiner.needs_view_gradients(step) for refiner in self)

    def regularizers(self, context: StepContext) -> dict[str, Tensor]:
        """The terms of all refiners, by name."""
        return {
            name: term
            for refiner in self
            for name, term in checked_terms(
                f"{type(refiner).__name__}.regularizers", refiner.regularizers(context)
            ).items()
        }

    def before_backward(self, context: StepContext, model: PrimitiveModel) -> None:
        """Let every refiner attach its hooks."""
        for refiner in self:
            refiner.before_backward(context, model)

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Let every refiner gather statistics of a batch."""
        for refiner in self:
            refiner.observe(context, statistics, model)

    def refine(
        self,
        step: int,
        steps: int,
        table: SplatTable,
        model: PrimitiveModel,
        generator: torch.Generator,
        limits_of_run: GrowthLimits = GrowthLimits(),  # noqa: B008 - frozen
        operators: Operators = Operators(),  # noqa: B008 - without state
    ) -> Refinement:
        """Let every refiner edit rows, in order; the sum of their edits, by verb.

        Limits are read again before each refiner, since the previous one may have changed them.
        Those of the run itself hold for all of them. ``operators`` are those of its device.
        """
        edits: Counter[str] = Counter()
        growth_due = any(refiner.growth_due(step) for refiner in self)
        for refiner in self:
            before, limits = table.row_edits, limits_of_run & self._limits(step, model)
            context = RefineContext(
                step, steps, table, model, generator, limits, growth_due, dict(edits), operators
            )
            found = checked_mapping(
                f"{type(refiner).__name__}.refine",
                refiner.refine(context),
                "numbers of edits by verb",
                'Return a mapping such as {"pruned": 3}; {} if nothing was edited.',
            )
            edits.update(found)
            if table.row_edits != before:
                for other in self:
                    other.rows_edited()
            if RESET in found:
                for other in self:
                    other.opacities_reset(step)
        return edits

    def _limits(self, step: int, model: PrimitiveModel) -> GrowthLimits:
        return reduce(and_, (r.limits(step, model) for r in self), GrowthLimits())

    def reset_due(self, step: int) -> bool:
        """True if any refiner resets opacities after ``step``."""
        return any(refiner.reset_due(step) for refiner in self)

    def report(self) -> dict[str, Any]:
        """Results of all refiners for ``requirements.json``."""
        return {key: value for r in self for key, value in r.report().items()}

    def state_dict(self) -> dict[str, Any]:
        """The state of each refiner, by name."""
        return {refiner.name: state_of(refiner) for refiner in self}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; a refiner without a state starts anew."""
        for refiner in self:
            load_part(refiner, state.get(refiner.name, {}))
