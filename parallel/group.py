"""Group: the processes of a training, as torch.distributed connects them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

from gsfw.parallel.environment import LostProcessError

Value = TypeVar("Value")


class Group:
    """Collective operations of all processes, which count the bytes that they send."""

    def __init__(self, device: torch.device) -> None:
        """Use the processes that ``joined`` has connected.

        Args:
            device: of the tensors that are exchanged.
        """
        self.device = device
        self.rank, self.size = dist.get_rank(), dist.get_world_size()
        self.bytes_sent = 0
        """Bytes that this process has sent to others, without those of ``gathered``."""

    def exchange(self, values: Tensor) -> Tensor:
        """Send part r of a tensor to process r; return the parts from all, in order of rank.

        Args:
            values: [size, k], one part for each process.
        """
        if self.size == 1:
            return values
        self.bytes_sent += values.nbytes * (self.size - 1) // self.size
        return self._exchanged(values)

    def exchange_rows(
        self, rows: Tensor, sent: Sequence[int], received: Sequence[int]
    ) -> list[Tensor]:
        """Send rows to every process; return those from each, in order of rank.

        Args:
            rows: [m, k]: those for the first process, then those for the next one, and so on.
            sent: number of rows for each process.
            received: number of rows that each process sends to this one.
        """
        if self.size == 1:
            return [rows]
        width = rows.nbytes // max(len(rows), 1)
        self.bytes_sent += (sum(sent) - sent[self.rank]) * width
        return self._exchanged_rows(rows, sent, received)

    def all_gather_rows(self, values: Tensor, counts: Sequence[int]) -> Tensor:
        """Rows of all processes, one after another in order of rank; every process has its number.

        Args:
            values: [counts[rank], ...] of this process.
            counts: number of rows of each process, the same in all.
        """
        if self.size == 1:
            return values
        longest = max(counts)
        padded = values.new_zeros(longest, *values.shape[1:])
        padded[: len(values)] = values
        found = self.all_gather(padded)
        return torch.cat([part[:count] for part, count in zip(found, counts, strict=True)])

    def all_gather(self, values: Tensor) -> Tensor:
        """The tensors of all processes, which have one shape, stacked in order of rank."""
        if self.size == 1:
            return values[None]
        self.bytes_sent += values.nbytes * (self.size - 1)
        return self._all_gathered(values.contiguous())

    def _exchanged(self, values: Tensor) -> Tensor:
        received = torch.empty_like(values)
        with losses_named():
            dist.all_to_all_single(received, values)
        return received

    def _exchanged_rows(
        self, rows: Tensor, sent: Sequence[int], received: Sequence[int]
    ) -> list[Tensor]:
        found = rows.new_empty(sum(received), *rows.shape[1:])
        with losses_named():
            dist.all_to_all_single(found, rows.contiguous(), list(received), list(sent))
        return list(found.split(list(received)))

    def _all_gathered(self, values: Tensor) -> Tensor:
        received = values.new_empty(self.size, *values.shape)
        with losses_named():
            dist.all_gather(list(received.unbind(0)), values)
        return received

    def gathered(self, value: Value) -> list[Value]:
        """The values of all processes in order of rank, as pickled objects."""
        found: list[Value | None] = [None] * self.size
        with losses_named():
            dist.all_gather_object(found, value)
        return found  # type: ignore[return-value]


@contextmanager
def losses_named() -> Iterator[None]:
    """Turn the errors of torch.distributed into one sentence.

    Raises:
        LostProcessError: another process has ended, or does not answer.
    """
    try:
        yield
    except (RuntimeError, ValueError) as error:
        # The path of a source file, the cause, and general advice.
        cause = re.sub(r"^\[[^]]*\]\s*", "", str(error).strip()).split(". ")[0].splitlines()[0]
        raise LostProcessError(
            f"another process of this training has ended or does not answer ({cause}).",
            "Its own message says why. Go on from the last checkpoint with gsfw resume RUN.",
        ) from error
