"""Group: the processes of a training, as torch.distributed connects them."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from traceback import clear_frames
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

from gsfw.core.errors import LostProcessError, SilentProcessError
from gsfw.parallel.environment import patience

Value = TypeVar("Value")
Pieces = Sequence[Tensor]
"""Contiguous tensors of one type, which are sent one after another."""
NEARLY_ALL = 0.95
"""Part of the longest wait after which a process counts as silent: the first one whose wait ends
closes its connections, and the others see them closed a little before their own waits end."""


class Group:
    """Collective operations of all processes, which count the bytes that they send."""

    def __init__(self, device: torch.device, channel: dist.ProcessGroup | None = None) -> None:
        """Use the processes that ``parallel.launch.connected`` has connected.

        Args:
            device: of the tensors that are exchanged.
            channel: connections of this group alone; ``None``: the first ones.
        """
        self.device, self._channel = device, channel
        self.rank, self.size = dist.get_rank(), dist.get_world_size()
        self.bytes_sent = 0
        """Bytes that this process has sent to others, without those of ``gathered``."""

    def spare(self) -> Group | None:
        """Close the connections of this group, which ends the waits of all other processes for it.

        Returns:
            A group by the first connections, by which all processes that still run can meet once
            more; ``None`` if this group uses them itself.
        """
        if self._channel is None:
            return None
        dist.destroy_process_group(self._channel)
        self._channel = None  # The last reference.
        return Group(self.device)

    @torch.no_grad()
    def exchange_into(self, sent: Sequence[Pieces], rooms: Sequence[Pieces]) -> None:
        """Send other tensors to each process, and receive in place what each sends to this one.

        Args:
            sent: contiguous tensors of one type for each process.
            rooms: contiguous tensors that receive what each process sends; their total size is that
                of what is sent.
        """
        _copy(sent[self.rank], rooms[self.rank])
        if self.size > 1:
            others = [() if rank == self.rank else part for rank, part in enumerate(sent)]
            self.bytes_sent += sum(map(num_bytes, others))
            free = [() if rank == self.rank else part for rank, part in enumerate(rooms)]
            self._exchange(others, free)

    def all_gather_rows(self, values: Tensor, counts: Sequence[int]) -> Tensor:
        """Rows of all processes, one after another in order of rank; every process has its number.

        Args:
            values: [counts[rank], ...] of this process.
            counts: number of rows of each process, the same in all.
        """
        if self.size == 1:
            return values
        found = values.new_empty(sum(counts), *values.shape[1:])
        self.share_into([values.contiguous()], [[room] for room in found.split(list(counts))])
        return found

    def all_gather(self, values: Tensor) -> Tensor:
        """The tensors of all processes, which have one shape, stacked in order of rank."""
        if self.size == 1:
            return values[None]
        found = values.new_empty(self.size, *values.shape)
        self.share_into([values.contiguous()], [[room] for room in found])
        return found

    @torch.no_grad()
    def share_into(self, sent: Pieces, rooms: Sequence[Pieces]) -> None:
        """Send the same tensors to all processes, and receive in place what each of them sends.

        Args:
            sent: contiguous tensors of one type.
            rooms: contiguous tensors that receive what each process sends; their total size is that
                of what is sent.
        """
        _copy(sent, rooms[self.rank])
        if self.size > 1:
            self.bytes_sent += num_bytes(sent) * (self.size - 1)
            self._share(sent, rooms)

    def _exchange(self, sent: Sequence[Pieces], rooms: Sequence[Pieces]) -> None:
        """Exchange tensors with the others; this process has none for itself."""
        values = _joined([piece for pieces in sent for piece in pieces], rooms)
        counts = [_count(pieces) for pieces in rooms]
        found = values.new_empty(sum(counts))
        with losses_named():
            dist.all_to_all_single(
                found,
                values,
                counts,
                [_count(pieces) for pieces in sent],
                self._channel,
            )
        _fill([room for pieces in rooms for room in pieces], found)

    def _share(self, sent: Pieces, rooms: Sequence[Pieces]) -> None:
        """Send tensors to the others; the rooms of this process have them."""
        longest = max(_count(pieces) for pieces in rooms)
        values = torch.nn.functional.pad(_joined(sent, rooms), (0, longest - _count(sent)))
        found = values.new_empty(self.size, longest)
        with losses_named():
            dist.all_gather(list(found.unbind(0)), values, self._channel)
        for rank, pieces in enumerate(rooms):
            if rank != self.rank:
                _fill(pieces, found[rank])

    def gathered(self, value: Value) -> list[Value]:
        """The values of all processes in order of rank, as pickled objects."""
        found: list[Value | None] = [None] * self.size
        with losses_named():
            dist.all_gather_object(found, value, self._channel)
        return found  # type: ignore[return-value]


def _count(pieces: Pieces) -> int:
    return sum(piece.numel() for piece in pieces)


def num_bytes(pieces: Pieces) -> int:
    """Bytes of some tensors."""
    return sum(piece.nbytes for piece in pieces)


def _joined(pieces: Pieces, rooms: Sequence[Pieces]) -> Tensor:
    """The values of tensors one after another; of the type of the rooms if there are none."""
    like = next(piece for part in (pieces, *rooms) for piece in part)
    return torch.cat([like.new_empty(0), *(piece.flatten() for piece in pieces)])


def _copy(pieces: Pieces, rooms: Pieces) -> None:
    """Copy the values of tensors into others, which may be divided in another way."""
    if [piece.numel() for piece in pieces] == [room.numel() for room in rooms]:
        for piece, room in zip(pieces, rooms, strict=True):
            room.copy_(piece.view_as(room))
    elif len(rooms) == 1 and rooms[0].device == pieces[0].device:
        torch.cat([piece.flatten() for piece in pieces], out=rooms[0].view(-1))
    else:
        _fill(rooms, torch.cat([piece.flatten() for piece in pieces]))


def _fill(rooms: Pieces, values: Tensor) -> None:
    """Divide values among tensors."""
    start = 0
    for room in rooms:
        room.copy_(values[start : start + room.numel()].view_as(room))
        start += room.numel()


@contextmanager
def losses_named() -> Iterator[None]:
    """Turn the errors of torch.distributed into one sentence.

    Raises:
        LostProcessError: another process has ended, or does not answer.
        SilentProcessError: it has not answered within the longest wait.
    """
    started = time.monotonic()
    try:
        yield
    except (RuntimeError, ValueError) as error:
        # The path of a source file, the cause, and general advice.
        text = re.sub(r"^\[[^]]*\]\s*", "", str(error).strip()).split(". ")[0]
        cause = text.partition("\n")[0] or type(error).__name__
        clear_frames(error.__traceback__)  # They refer to the connections, which ``spare`` closes.
        is_silent = time.monotonic() - started >= NEARLY_ALL * 60 * patience()
        raise (SilentProcessError if is_silent else LostProcessError)(
            f"another process of this training has ended or does not answer ({cause}).",
            "Its own message says why. Go on from the last checkpoint with gsfw resume RUN.",
        ) from error
