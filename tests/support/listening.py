"""Addresses that processes listen on, as Linux tells them."""

import os
import socket
import struct
from pathlib import Path

import pytest

LISTENS = "0A"
"""State of a socket in /proc/net/tcp."""


def addresses(*processes: int) -> set[str]:
    """All of some processes, or of this one; skips the test where there is no /proc."""
    if not Path("/proc/self/net/tcp").exists():
        pytest.skip("/proc/self/net/tcp is of Linux")
    own = {name for process in processes or (os.getpid(),) for name in _sockets(process)}
    found = set()
    for table, family in (("tcp", socket.AF_INET), ("tcp6", socket.AF_INET6)):
        for line in Path("/proc/self/net", table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == LISTENS and fields[9] in own:
                digits = bytes.fromhex(fields[1].partition(":")[0])
                words = struct.unpack(f">{len(digits) // 4}I", digits)
                packed = struct.pack(f"={len(words)}I", *words)
                found.add(socket.inet_ntop(family, packed))
    return found


def children(process: int) -> list[int]:
    """Processes that a process has started, and those that these have."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found += [child, *children(child)]
    return found


def _sockets(process: int):
    folder = Path(f"/proc/{process}/fd")
    try:
        names = os.listdir(folder)
    except OSError:  # It has ended meanwhile.
        return
    for name in names:
        try:
            target = os.readlink(folder / name)
        except OSError:  # That of the listing itself.
            continue
        if target.startswith("socket:["):
            yield target[len("socket:[") : -1]
