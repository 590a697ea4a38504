"""Work of connected processes, which exchange tensors through shared memory and through sockets.

It is not in a test file: processes that start anew cannot import one.
"""

import multiprocessing
import os
import socket

import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing as mp

from gsfw.parallel import shared_memory
from gsfw.parallel.group import Group
from gsfw.parallel.shared_memory import SharedMemoryGroup, group_on

SIZE = 3
CPU = torch.device("cpu")
START = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""A server of forks imports torch once for all processes of all tests."""


def in_processes(work, *arguments) -> None:
    """Run ``work(rank, ...)`` in connected processes; what fails in one of them fails here."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    multiprocessing.set_forkserver_preload(["gsfw.parallel.shared_memory"])
    mp.start_processes(_connected, (port, work, arguments), SIZE, start_method=START)


def _connected(rank, port, work, arguments) -> None:
    os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    torch.set_num_threads(1)
    dist.init_process_group("gloo", rank=rank, world_size=SIZE)
    work(rank, *arguments)
    dist.barrier()
    dist.destroy_process_group()


def all_operations(rank) -> None:
    shared_memory.CHUNK, shared_memory.LEAST = 1000, 64  # Messages of several chunks.
    fast, plain = group_on(CPU), Group(CPU)
    assert isinstance(fast, SharedMemoryGroup)
    for seed in range(12):
        both = torch.Generator().manual_seed(seed)
        table = torch.randint(0, 90, (SIZE, SIZE), generator=both)
        table[table < 30] = 0
        width = int(torch.randint(1, 9, (), generator=both))
        own = torch.Generator().manual_seed(100 * seed + rank)
        sent, received = table[rank].tolist(), table[:, rank].tolist()
        rows = torch.randn(sum(sent), width, generator=own)
        exchanged = []
        for group in (fast, plain):
            found = torch.zeros(sum(received), width)
            pieces = [part.split(7) for part in rows.split(sent)]
            group.exchange_into(pieces, [[room] for room in found.split(received)])
            exchanged.append(found)
        assert torch.equal(*exchanged)
        assert torch.equal(
            fast.all_gather_rows(rows, table.sum(1).tolist()),
            plain.all_gather_rows(rows, table.sum(1).tolist()),
        )
        values = torch.randint(0, 2, (SIZE, 40 * seed), generator=own)
        for dtype in (torch.bool, torch.float64, torch.int32):
            typed = values.to(dtype)
            turned = typed.T  # Not contiguous.
            assert torch.equal(fast.all_gather(turned), plain.all_gather(turned))
    assert fast.bytes_sent == plain.bytes_sent > 0
    rows = torch.ones(99, requires_grad=True)
    with pytest.raises(RuntimeError, match="396 bytes were sent, and 200 expected"):
        fast.share_into([rows], [[torch.empty(99 if rank == r else 50)] for r in range(SIZE)])


def one_without_memory(rank) -> None:
    if rank == 1:
        shared_memory._opened = lambda size: None
    group = group_on(CPU)
    assert type(group) is Group
    values = torch.full((100_000,), rank)
    assert group.all_gather(values)[:, 0].tolist() == [0, 1, 2]


def one_with_another_token(rank) -> None:
    if rank == 2:  # The number of a file of another container's process.
        opened = shared_memory._box_of
        shared_memory._box_of = lambda pid, number, token: opened(pid, number, bytes(16))
    assert type(group_on(CPU)) is Group
