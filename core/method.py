"""Method: a model and what it is trained with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.strategy import Refinement
from gsfw.core.table import SplatTable


class Method(ABC):
    """A model and what it is trained with: losses, phases, and what it expects of a scene."""

    def check_scene(self, scene: Scene) -> None:  # noqa: B027
        """Refuse a scene this method cannot be trained on.

        Raises:
            ConfigError: saying what the scene lacks and what to do.
        """

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """What the user should know before it starts, such as what random initialisation costs."""
        return ()

    @abstractmethod
    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> PrimitiveModel:
        """The model before its first step, on the CPU.

        Args:
            scene: what is known of the capture.
            operators: for nearest neighbours.
            generator: on the CPU; the only source of randomness.
            initial: splats to start from (``init=FILE``), in the scene frame; ``None`` otherwise.
        """

    def prepare_batch(self, batch: Batch, step: int) -> Batch:
        """What a step trains on instead of the pictures as they are: smaller ones, for instance."""
        return batch

    def looks_at_single_views(self, step: int) -> bool:
        """Whether the gradients of single views matter at ``step``: each is then drawn by itself.

        The loss of a step with several views stays the mean over them.
        """
        return False

    @abstractmethod
    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """Weighted scalars whose sum is minimised, by name."""

    def phase(self, step: int) -> str:
        """Name of the phase ``step`` is in (coarse, fine; a time step)."""
        return "train"

    def prepare(  # noqa: B027
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Before each step: SH degree, phase changes, freezing, forward initialisation.

        Args:
            step: counted from 0.
            model: may change its values, not its rows.
            optimizer: for what is to be frozen, or to begin with fresh moments.
            time: of the step's first view, in [0, 1]; ``None`` for a static capture.
        """

    def adapt(
        self, step: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> Refinement:
        """After each refinement: parameters that single rows gain or lose (bands, motion).

        What it did, by verb, as a strategy says it; empty when nothing.
        """
        return {}

    def report(self) -> Mapping[str, Any]:
        """What it has to say of the finished run, as plain data for ``requirements.json``."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data; what ``phase`` and ``prepare`` depend on besides the step."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:  # noqa: B027
        """Continue from ``state``."""
