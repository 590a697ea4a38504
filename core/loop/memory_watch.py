"""Memory watch: what a run gives up while main memory runs short, so that nothing kills it.

A run looks at its memory every few steps. While there is enough, the watch changes nothing, and the
run has the bits of one without a watch.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from gsfw.core.loop.full_memory import main_memory_full
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.machine_memory import MachineMemory, machine_memory
from gsfw.core.refiner import GrowthLimits
from gsfw.core.training_memory import model_row_memory
from gsfw.core.words import size

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer

logger = logging.getLogger("gsfw.run")

EVERY = 10
"""Steps from one look to the next: a look takes 0.1 ms, and models grow every 100 steps."""
TIGHT, FULL = 0.1, 0.03
"""Parts of the allowed memory: while less than the first is free, no row is added and decoded
images are dropped; with less than the second the run ends with a checkpoint."""
END_BYTES = 120e6
"""Memory that stays free of rows, however little is allowed: the evaluation, the charts and the
files at the end took 100 MB where they were measured."""
GROWN = 4.0
"""Memory of a new row while it is added, over that of a row: columns are there twice then. 22,000
new Gaussians of SH degree 3 took 3900 bytes each, 2.9 times as much as those that stay."""
USUAL_GROWTH = 0.3
"""Part of its rows that a model usually gains at a time, at most; none more than doubles."""


class MemoryWatch:
    """Limits growth and drops images where memory is short, and ends a run that has none left."""

    def __init__(
        self, is_on: bool, read: Callable[[], MachineMemory | None] = machine_memory
    ) -> None:
        """Nothing is read yet.

        Args:
            is_on: false for a run that trains whatever memory there is.
            read: gives the memory of this process; ``None`` where it is unknown.
        """
        self._is_on, self._read = is_on, read
        self._limits = GrowthLimits()
        self._told: set[str] = set()

    def limits(self, trainer: Trainer) -> GrowthLimits:
        """The limit of growth by the memory that is free, between two steps.

        Raises:
            NotEnoughMemoryError: hardly any memory is free; a checkpoint is written.
        """
        if self._is_on and trainer.step % EVERY == 0:
            memory = self._read()
            # Only Linux tells what the process has.
            known = memory is not None and memory.own > 0
            self._limits = self._look(trainer, memory) if known and memory else GrowthLimits()
        return self._limits

    def _look(self, trainer: Trainer, memory: MachineMemory) -> GrowthLimits:
        """Do what the free memory asks for."""
        free, model = memory.free + memory.swap, trainer.parts.refined
        tight = max(TIGHT * memory.allowed, END_BYTES)
        if free < tight:
            free += trainer.parts.data.drop_images()
            release_freed_memory()
            self._tell(trainer.step, memory, "fewer decoded images are kept (cache_mb)")
        if free < FULL * memory.allowed:
            raise main_memory_full(trainer, memory)
        new = int(max(free - tight, 0.0) / max(GROWN * model_row_memory(model).peak, 1.0))
        if new >= model.num_rows:
            return GrowthLimits()
        if new < USUAL_GROWTH * model.num_rows:
            self._tell(trainer.step, memory, "growth slows down, and ends where memory does")
        return GrowthLimits(max_rows=model.num_rows + new)

    def _tell(self, step: int, memory: MachineMemory, measure: str) -> None:
        """Say once what is done."""
        if measure not in self._told:
            self._told.add(measure)
            left = size(memory.free + memory.swap)
            logger.warning(
                "step %d: memory runs short (%s are free, and %s): %s. check_memory=false trains "
                "without such limits.", step, left, memory, measure,
            )  # fmt: skip
