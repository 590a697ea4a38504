"""Processes of a training as threads of one: the collective operations without a network."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import torch

from gsfw.core.errors import LostProcessError
from gsfw.parallel.group import Group, Pieces

Result = TypeVar("Result")

PATIENCE = 60.0
"""Seconds after which a thread that waits for another one fails."""


class Table:
    """The place where threads put their values."""

    def __init__(self, size: int, spare: "Table | None" = None) -> None:
        self.size, self.spare = size, spare
        self.values: list[Any] = [None] * size
        self._changed = threading.Condition()
        self._meetings, self._waiting, self._is_left = 0, 0, False

    def shared(self, rank: int, value: Any) -> list[Any]:
        self.values[rank] = value
        self.wait()
        found = list(self.values)
        self.wait()
        return found

    def wait(self) -> None:
        """Wait for the other threads, unless one of them has left."""
        with self._changed:
            meeting, self._waiting = self._meetings, self._waiting + 1
            if self._waiting == self.size and not self._is_left:
                self._meetings, self._waiting = meeting + 1, 0
                self._changed.notify_all()
            self._changed.wait_for(lambda: self._meetings > meeting or self._is_left, PATIENCE)
            if self._meetings == meeting:
                raise LostProcessError("another thread has ended.")

    def leave(self) -> None:
        """End the waits of all other threads, as the end of a process does."""
        with self._changed:
            self._is_left = True
            self._changed.notify_all()


class ThreadGroup(Group):
    """A group of threads; counts bytes as the group of processes does."""

    def __init__(self, table: Table, rank: int) -> None:
        self._table = table
        self.device = torch.device("cpu")
        self.rank, self.size, self.bytes_sent = rank, table.size, 0

    def spare(self) -> Group | None:
        self._table.leave()
        return None if self._table.spare is None else ThreadGroup(self._table.spare, self.rank)

    def _exchange(self, sent: Sequence[Pieces], rooms: Sequence[Pieces]) -> None:
        for rank, pieces in enumerate(self._table.shared(self.rank, sent)):
            self._receive(rank, pieces[self.rank], rooms)
        self._table.wait()  # What is sent may change now.

    def _share(self, sent: Pieces, rooms: Sequence[Pieces]) -> None:
        for rank, pieces in enumerate(self._table.shared(self.rank, sent)):
            self._receive(rank, pieces, rooms)
        self._table.wait()

    def _receive(self, rank: int, pieces: Pieces, rooms: Sequence[Pieces]) -> None:
        if rank == self.rank or not pieces:
            return
        found = torch.cat([piece.flatten() for piece in pieces])
        sizes = [room.numel() for room in rooms[rank]]
        for room, part in zip(rooms[rank], found.split(sizes), strict=True):
            room.copy_(part.view_as(room))

    def gathered(self, value: Any) -> list[Any]:
        return self._table.shared(self.rank, value)


def in_threads(size: int, work: Callable[[Group], Result]) -> Sequence[Result]:
    """Run ``work`` in every process of a group; the results in order of rank."""
    table = Table(size, Table(size))
    with ThreadPoolExecutor(size) as pool:
        futures = [pool.submit(work, ThreadGroup(table, rank)) for rank in range(size)]
        return [future.result() for future in futures]
