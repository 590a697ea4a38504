"""Shared memory: exchange between processes of one machine, without its network.

torch.distributed (gloo) sends tensors through sockets, which copies each several times. Here a
process writes what it sends into memory that the others can read. Each has a box of two halves that
take turns: a half is written, all processes meet (by gloo, which finds those that have ended), and
the others copy their parts. When all have met once more, it may be written again. Longer messages
go in chunks, so that the memory of the boxes does not grow with them.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Sequence
from itertools import accumulate, pairwise

import torch
import torch.distributed as dist
from jaxtyping import UInt8
from torch import Tensor

from gsfw.parallel.group import Group, losses_named

CHUNK = 16 << 20
"""Bytes of a half of a box. To meet takes as long as to copy some of them; pages that no message
reaches take no memory."""
LEAST = 1 << 16
"""Shorter messages, in bytes, go by gloo: to meet takes as long."""
TOKEN = 16
"""Bytes by which a process knows the box of another one."""
Bytes = UInt8[Tensor, " b"]


def group_on(device: torch.device) -> Group:
    """The group of all processes, by shared memory if they are on one machine and train on CPUs."""
    group = Group(device)
    if group.size == 1 or device.type != "cpu":
        return group
    boxes = _boxes(group)
    return group if boxes is None else SharedMemoryGroup(device, boxes)


class SharedMemoryGroup(Group):
    """The processes of one machine."""

    def __init__(self, device: torch.device, boxes: Sequence[Bytes]) -> None:
        """Exchange by ``boxes``, one of each process, which all processes have mapped."""
        super().__init__(device)
        self._boxes = [_Box(box, self.size) for box in boxes]
        self._round = 0

    def _exchanged(self, values: Tensor) -> Tensor:
        if values.nbytes < LEAST:
            return super()._exchanged(values)
        found = torch.empty_like(values, memory_format=torch.contiguous_format)
        width = values.nbytes // self.size
        found[self.rank] = values[self.rank]
        self._deliver(_bytes(values), _ranges([width] * self.size), found.unbind(0))
        return found

    def _exchanged_rows(
        self, rows: Tensor, sent: Sequence[int], received: Sequence[int]
    ) -> list[Tensor]:
        width = rows[:1].nbytes
        found = [rows.new_empty(count, *rows.shape[1:]) for count in received]
        found[self.rank] = rows.split(list(sent))[self.rank]
        self._deliver(_bytes(rows), _ranges([count * width for count in sent]), found)
        return found

    def _all_gathered(self, values: Tensor) -> Tensor:
        if values.nbytes < LEAST:
            return super()._all_gathered(values)
        found = values.new_empty(self.size, *values.shape)
        found[self.rank] = values
        ranges = [(0, 0 if rank == self.rank else values.nbytes) for rank in range(self.size)]
        self._deliver(_bytes(values), ranges, found.unbind(0))
        return found

    def _deliver(
        self, sent: Bytes, ranges: Sequence[tuple[int, int]], received: Sequence[Tensor]
    ) -> None:
        """Write the bytes for others, and copy those from others.

        Args:
            sent: bytes for all processes.
            ranges: begin and end of the bytes for each process; those for this one are not needed.
            received: room for what each of the others sends; contiguous.
        """
        start, rounds = 0, 1
        while start < rounds * CHUNK:
            half, self._round = self._round % 2, self._round + 1
            own = self._boxes[self.rank]
            own.write(half, start, sent, ranges, self.rank)
            rounds = self._meet(-(-len(sent) // CHUNK))
            for rank, (box, room) in enumerate(zip(self._boxes, received, strict=True)):
                if rank != self.rank:
                    box.read(half, self.rank, start, _bytes(room))
            start += CHUNK

    def _meet(self, rounds: int) -> int:
        """Wait for all processes; the largest number of rounds that any of them needs."""
        numbers = torch.empty(self.size, 1, dtype=torch.int64)
        with losses_named():
            dist.all_gather(list(numbers.unbind(0)), torch.tensor([rounds]))
        return int(numbers.max())


class _Box:
    """Memory of one process in two halves, each with the ranges of all processes before it."""

    def __init__(self, memory: Bytes, size: int) -> None:
        self._ranges, self._halves = [], []
        for half in memory[TOKEN:].view(2, -1):
            self._ranges.append(half[: 16 * size].view(torch.int64).view(size, 2))
            self._halves.append(half[16 * size :])

    def write(
        self, half: int, start: int, sent: Bytes, ranges: Sequence[tuple[int, int]], rank: int
    ) -> None:
        """Write the chunk of a message that begins at ``start``, and the ranges of each process.

        The bytes for the process itself are left out.
        """
        self._ranges[half].copy_(torch.tensor(ranges))
        stop = min(start + CHUNK, len(sent))
        first, last = ranges[rank]
        for begin, end in ((start, min(first, stop)), (max(last, start), stop)):
            if begin < end:
                self._halves[half][begin - start : end - start].copy_(sent[begin:end])

    def read(self, half: int, rank: int, start: int, room: Bytes) -> None:
        """Copy the bytes for a process, of the part of the message that begins at ``start``."""
        first, last = self._ranges[half][rank].tolist()
        begin, end = max(first, start), min(last, start + CHUNK)
        if begin < end:
            part = self._halves[half][begin - start : end - start]
            room[begin - first : end - first].copy_(part)


def _ranges(counts: Sequence[int]) -> list[tuple[int, int]]:
    """Begin and end of parts that follow one another."""
    return list(pairwise([0, *accumulate(counts)]))


def _boxes(group: Group) -> list[Bytes] | None:
    """A box of each process; ``None`` if they are not on one machine, or it has no such memory."""
    own, found = _opened(TOKEN + 2 * (16 * group.size + CHUNK)), []
    token = b"" if own is None else os.urandom(TOKEN)
    if own is not None:
        _mapped(own)[:TOKEN].copy_(torch.frombuffer(bytearray(token), dtype=torch.uint8))
    for pid, number, told in group.gathered((os.getpid(), own, token)):
        box = None if number is None else _box_of(pid, number)
        found.append(box if box is not None and bytes(box[:TOKEN].tolist()) == told else None)
    all_found = all(group.gathered(None not in found))
    if own is not None:
        os.close(own)
    return [box for box in found if box is not None] if all_found else None


def _opened(size: int) -> int | None:
    """A file in memory, of which no folder limits the size; ``None`` where there are none."""
    if not hasattr(os, "memfd_create"):
        return None
    try:
        number = os.memfd_create("gsfw")
        os.ftruncate(number, size)
    except OSError:
        return None
    return number


def _box_of(pid: int, number: int) -> Bytes | None:
    """The memory of a file of another process; ``None`` if it is not to be had."""
    try:
        file = os.open(f"/proc/{pid}/fd/{number}", os.O_RDWR)
    except OSError:  # It is of another machine or container, or of another user.
        return None
    try:
        return _mapped(file)
    except (OSError, ValueError):
        return None
    finally:
        os.close(file)


def _mapped(number: int) -> Bytes:
    return torch.frombuffer(mmap.mmap(number, 0), dtype=torch.uint8)


def _bytes(values: Tensor) -> Bytes:
    """The memory of a tensor."""
    return values.contiguous().view(-1).view(torch.uint8)
