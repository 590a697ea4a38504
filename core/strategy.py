"""DensityStrategy: decides which splats to add, move and remove."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Depth, Statistic
from gsfw.core.table import SplatTable

Refinement = Mapping[str, int]
"""What a refinement did, by verb: {"cloned": 12, "pruned": 3}; empty when it did nothing."""


class DensityStrategy(ABC):
    """Decides which splats to add, move and remove, in the model's own terms."""

    def statistics(self, step: int) -> frozenset[Statistic]:
        """What it wants measured at ``step``; nothing once it no longer refines."""
        return frozenset()

    def depth(self, step: int) -> Depth:
        """Which depth image it wants drawn at ``step``, to look at it in ``observe``."""
        return Depth.NONE

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Weighted scalars to add to the loss, by name."""
        return {}

    @abstractmethod
    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """After the optimizer step, once per batch; of a step that was not finite, with nothing.

        Statistics come in the order of the splats drawn: scatter them through
        ``context.splats.rows`` and count views, so that several views in a step weigh the same.
        The model still has the gradients of the whole step (``time_gradients``).
        """

    @abstractmethod
    def refine(
        self, step: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> Refinement:
        """Called after every optimizer step (counted from 0); edits rows when it is time."""

    def report(self) -> Mapping[str, Any]:
        """What it has to say of the finished run, as plain data for ``requirements.json``."""
        return {}

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
