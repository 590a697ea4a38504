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
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise

import torch
import torch.distributed as dist
from jaxtyping import UInt8
from torch import Tensor

from gsfw.parallel.group import Group, Pieces, losses_named, num_bytes

CHUNK = 16 << 20
"""Bytes of a half of a box. Each chunk costs a meeting of the processes, so that chunks are large;
pages that no message reaches take no memory."""
LEAST = 1 << 16
"""Tensors for all processes go by gloo if they are smaller than this on average, in bytes: to meet
takes as long. An exchange always uses the boxes, as no process knows the sizes of all messages."""
NAME = "gsfw"
TOKEN = 16
"""Bytes by which a process knows the box of another one."""
Bytes = UInt8[Tensor, " b"]


def group_on(device: torch.device, channel: dist.ProcessGroup | None = None) -> Group:
    """The group of all processes, by shared memory if they are on one machine and train on CPUs."""
    group = Group(device, channel)
    if group.size == 1 or device.type != "cpu":
        return group
    boxes = _boxes(group)
    return group if boxes is None else SharedMemoryGroup(device, boxes, channel)


class SharedMemoryGroup(Group):
    """The processes of one machine."""

    def __init__(
        self, device: torch.device, boxes: Sequence[Bytes], channel: dist.ProcessGroup | None
    ) -> None:
        """Exchange by ``boxes``, one of each process, which all processes have mapped."""
        super().__init__(device, channel)
        self._boxes = [_Box(box, self.size) for box in boxes]
        self._turn = 0

    def _exchange(self, sent: Sequence[Pieces], rooms: Sequence[Pieces]) -> None:
        ends = accumulate((num_bytes(pieces) for pieces in sent), initial=0)
        ranges = list(pairwise(ends))
        self._deliver([piece for pieces in sent for piece in pieces], ranges, rooms)

    def _share(self, sent: Pieces, rooms: Sequence[Pieces]) -> None:
        if sum(map(num_bytes, rooms)) < LEAST * self.size:
            super()._share(sent, rooms)
            return
        self._deliver(sent, [(0, num_bytes(sent))] * self.size, rooms)

    def _deliver(
        self, sent: Pieces, ranges: Sequence[tuple[int, int]], rooms: Sequence[Pieces]
    ) -> None:
        """Write the bytes for others, and copy those from others.

        Args:
            sent: what this process sends.
            ranges: begin and end of the bytes of it that are for each process.
            rooms: for what each process sends here.
        """
        message, received = _Message(sent), [_Message(pieces) for pieces in rooms]
        start, chunks = 0, 1
        while start < chunks * CHUNK:
            half, self._turn = self._turn % 2, self._turn + 1
            self._boxes[self.rank].write(half, message, start, ranges)
            chunks = self._meet(-(-message.size // CHUNK))
            for rank, (box, room) in enumerate(zip(self._boxes, received, strict=True)):
                if rank != self.rank:
                    box.read(half, self.rank, start, room)
            start += CHUNK

    def _meet(self, chunks: int) -> int:
        """Wait for all processes; the largest number of chunks that any of them sends."""
        numbers = torch.empty(self.size, 1, dtype=torch.int64)
        with losses_named():
            dist.all_gather(list(numbers.unbind(0)), torch.tensor([chunks]), self._channel)
        return int(numbers.max())


class _Message:
    """The bytes of some tensors, one after another."""

    def __init__(self, pieces: Pieces) -> None:
        parts = [piece.view(-1).view(torch.uint8) for piece in pieces]
        ends = list(accumulate(map(len, parts), initial=0))
        self.size = ends[-1]
        self._parts = list(zip(parts, pairwise(ends), strict=True))

    def within(self, start: int, stop: int) -> Iterator[tuple[Bytes, int]]:
        """The parts of its tensors between two places, each with its place."""
        for part, (first, last) in self._parts:
            begin, end = max(first, start), min(last, stop)
            if begin < end:
                yield part[begin - first : end - first], begin


class _Box:
    """Memory of one process in two halves, each with the ranges of all processes before it."""

    def __init__(self, memory: Bytes, size: int) -> None:
        self._ranges, self._halves = [], []
        for half in memory[TOKEN:].view(2, -1):
            self._ranges.append(half[: 16 * size].view(torch.int64).view(size, 2))
            self._halves.append(half[16 * size :])

    def write(
        self, half: int, message: _Message, start: int, ranges: Sequence[tuple[int, int]]
    ) -> None:
        """Write a chunk of a message, and the range of the whole of it for each process."""
        self._ranges[half].copy_(torch.tensor(ranges))
        for part, place in message.within(start, start + CHUNK):
            self._halves[half][place - start :][: len(part)].copy_(part)

    def read(self, half: int, rank: int, start: int, room: _Message) -> None:
        """Copy what a chunk has for a process.

        Raises:
            RuntimeError: the room is not as large as the message for the process.
        """
        first, last = self._ranges[half][rank].tolist()
        if last - first != room.size:
            raise RuntimeError(f"{last - first} bytes were sent, and {room.size} expected")
        begin, end = max(first, start), min(last, start + CHUNK)
        for part, place in room.within(begin - first, end - first):
            part.copy_(self._halves[half][place + first - start :][: len(part)])


def _boxes(group: Group) -> list[Bytes] | None:
    """A box of each process; ``None`` if they are not on one machine, or it has no such memory."""
    own, token = _opened(TOKEN + 2 * (16 * group.size + CHUNK)), os.urandom(TOKEN)
    if own is not None:
        own[1][:TOKEN].copy_(torch.frombuffer(bytearray(token), dtype=torch.uint8))
    told = group.gathered((os.getpid(), -1 if own is None else own[0], token))
    found = [_box_of(*process) for process in told]
    boxes = [box for box in found if box is not None]
    all_found = all(group.gathered(len(boxes) == group.size))
    if own is not None:
        os.close(own[0])
    return boxes if all_found else None


def _opened(size: int) -> tuple[int, Bytes] | None:
    """A file in memory, of which no folder limits the size; ``None`` where there is none."""
    if not hasattr(os, "memfd_create"):
        return None
    number = None
    try:
        number = os.memfd_create(NAME)
        os.ftruncate(number, size)
        return number, _mapped(number)
    except OSError:  # A limit of this process forbids it.
        if number is not None:
            os.close(number)
        return None


def _box_of(pid: int, number: int, token: bytes) -> Bytes | None:
    """The memory of a file of another process; ``None`` if it is not to be had."""
    path = f"/proc/{pid}/fd/{number}"
    try:
        # In another container or machine the number may be that of any file.
        if not os.readlink(path).startswith(f"/memfd:{NAME}"):
            return None
        file = os.open(path, os.O_RDWR)
    except OSError:
        return None
    try:
        box = _mapped(file)
    except (OSError, ValueError):
        return None
    finally:
        os.close(file)
    return box if bytes(box[:TOKEN].tolist()) == token else None


def _mapped(number: int) -> Bytes:
    return torch.frombuffer(mmap.mmap(number, 0), dtype=torch.uint8)
