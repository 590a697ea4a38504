"""Processes of a training as threads of one: the collective operations without a network."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

import torch
from torch import Tensor

from gsfw.parallel.group import Group

Result = TypeVar("Result")

PATIENCE = 60.0
"""Seconds after which a thread that waits for another one fails."""


@dataclass
class Table:
    """The place where threads put their values."""

    size: int
    values: list[Any] = field(init=False)
    barrier: threading.Barrier = field(init=False)

    def __post_init__(self) -> None:
        self.values = [None] * self.size
        self.barrier = threading.Barrier(self.size, timeout=PATIENCE)

    def shared(self, rank: int, value: Any) -> list[Any]:
        self.values[rank] = value
        self.barrier.wait()
        found = list(self.values)
        self.barrier.wait()
        return found


class ThreadGroup(Group):
    """A group of threads; counts bytes as the group of processes does."""

    def __init__(self, table: Table, rank: int) -> None:
        self._table = table
        self.device = torch.device("cpu")
        self.rank, self.size, self.bytes_sent = rank, table.size, 0

    def _exchanged(self, values: Tensor) -> Tensor:
        return torch.stack([part[self.rank] for part in self._table.shared(self.rank, values)])

    def _exchanged_rows(
        self, rows: Tensor, sent: Sequence[int], received: Sequence[int]
    ) -> list[Tensor]:
        parts = self._table.shared(self.rank, rows.split(list(sent)))
        found = [part[self.rank] for part in parts]
        assert [len(part) for part in found] == list(received)
        return found

    def _all_gathered(self, values: Tensor) -> Tensor:
        return torch.stack(self._table.shared(self.rank, values))

    def gathered(self, value: Any) -> list[Any]:
        return self._table.shared(self.rank, value)


def in_threads(size: int, work: Callable[[Group], Result]) -> Sequence[Result]:
    """Run ``work`` in every process of a group; the results in order of rank."""
    table = Table(size)
    with ThreadPoolExecutor(size) as pool:
        futures = [pool.submit(work, ThreadGroup(table, rank)) for rank in range(size)]
        return [future.result() for future in futures]
