"""Memory watch: what a run gives up while main memory runs short, so that nothing kills it.

A run looks at its memory every few steps. While there is enough, the watch changes nothing, and the
run has the bits of one without a watch. Several processes of a training go by the one that has
least room, so that all of them edit the same rows.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from gsfw.core.loop.full_memory import main_memory_full
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.machine_memory import MachineMemory, gpu_memory, process_memory
from gsfw.core.refiner import GrowthLimits
from gsfw.core.training_memory import CERTAIN, model_row_memory
from gsfw.core.words import size

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer

logger = logging.getLogger("gsfw.run")

EVERY, GPU_EVERY = 10, 100
"""Steps from one look to the next. Models grow every 100 steps; a look takes 0.1 ms, on a GPU
perhaps more."""
TIGHT, FULL = 0.1, 0.03
"""Parts of the allowed memory: while less than the first is free, no row is added and decoded
images are dropped; with less than the second of main memory the run ends with a checkpoint. A GPU
that is full ends no process: torch has an error for it."""
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
        self,
        is_on: bool,
        device: torch.device,
        read: Callable[[], MachineMemory | None] = process_memory,
    ) -> None:
        """Nothing is read yet.

        Args:
            is_on: false for a run that trains whatever memory there is.
            device: of the model.
            read: gives the main memory of this process; ``None`` where it is unknown.
        """
        self._is_on, self._device, self._read = is_on, device, read
        self._every = EVERY if device.type == "cpu" else GPU_EVERY
        self._looked = -1
        self._limits = GrowthLimits()
        self._told: set[str] = set()

    def limits(self, trainer: Trainer) -> GrowthLimits:
        """The limit of growth by the memory that is free, between two steps of all processes.

        Raises:
            NotEnoughMemoryError: hardly any main memory is free; a checkpoint is written.
        """
        # A run may begin at any step, and one call may stand for several steps.
        if self._is_on and trainer.step // self._every != self._looked:
            self._looked = trainer.step // self._every
            looks = trainer.parts.team.gathered(self._look(trainer))
            known = [look for look in looks if look is not None]
            least = min(known, key=lambda look: (not look.is_full, look.new_rows), default=None)
            self._limits = GrowthLimits() if least is None else self._limited(trainer, least)
        return self._limits

    def _look(self, trainer: Trainer) -> _Look | None:
        """Read the memory of this process, and drop its images if little is free."""
        memory = self._read()
        free = 0.0
        if memory is not None and memory.own <= 0:  # Only Linux tells what the process has.
            memory = None
        if memory is not None:
            free = memory.free + memory.swap
            if free < _tight(memory):
                free += trainer.parts.data.drop_images()
                release_freed_memory()
                self._tell(trainer, memory, "fewer decoded images are kept (cache_mb)")
            if free < FULL * memory.fair + self._coming(trainer):
                return _Look(memory, 0, is_full=True)
        if self._device.type == "cuda":
            memory = gpu_memory(self._device)
            free = memory.free - trainer.updates.idle_memory
        if memory is None:
            return None
        model, whole = trainer.parts.model, trainer.parts.refined
        room = max(free - _tight(memory), 0.0)
        own_rows = int(room / max(GROWN * model_row_memory(model).peak, 1.0))
        return _Look(memory, own_rows * whole.num_rows // max(model.num_rows, 1))

    def _coming(self, trainer: Trainer) -> float:
        """Bytes of gradients and moments that the first step of a run takes in main memory."""
        if trainer.step or self._device.type != "cpu":
            return 0.0
        model = trainer.parts.model
        return CERTAIN * model.num_rows * model_row_memory(model).first

    def _limited(self, trainer: Trainer, look: _Look) -> GrowthLimits:
        """The limit of growth by the look of the process that has least room."""
        if look.is_full:
            full = main_memory_full(trainer, look.memory)
            if trainer.parts.team.leads:
                raise full
            trainer.parts.team.gathered(None)  # Until the first process has ended.
        rows = trainer.parts.refined.num_rows
        if look.new_rows >= rows:
            return GrowthLimits()
        if look.new_rows < USUAL_GROWTH * rows and trainer.parts.team.leads:
            self._tell(trainer, look.memory, "growth slows down, and stops before memory is full")
        return GrowthLimits(max_rows=rows + look.new_rows)

    def _tell(self, trainer: Trainer, memory: MachineMemory, measure: str) -> None:
        """Say once what is done."""
        if measure not in self._told:
            self._told.add(measure)
            left = size(memory.free + memory.swap)
            logger.warning(
                "step %d: memory runs short (%s are free, and %s): %s. check_memory=false trains "
                "without such limits.", trainer.step, left, memory, measure,
            )  # fmt: skip


def _tight(memory: MachineMemory) -> float:
    """Free memory below which no row is added; in bytes."""
    return max(TIGHT * memory.fair, END_BYTES)


@dataclass(frozen=True)
class _Look:
    """The memory of one process, and the rows that it has room for."""

    memory: MachineMemory
    """The memory of the rows, or main memory if that is full."""
    new_rows: int
    """Rows that the whole model may gain, where each process has its part of them or all."""
    is_full: bool = False
    """True if hardly any main memory is free."""
