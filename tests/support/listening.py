"""Addresses that this process listens on, as Linux tells them."""

import os
import socket
import struct
from pathlib import Path

import pytest

LISTENS = "0A"
"""State of a socket in /proc/net/tcp."""


def addresses() -> set[str]:
    """All of them; skips the test where there is no /proc."""
    if not Path("/proc/self/net/tcp").exists():
        pytest.skip("/proc/self/net/tcp is of Linux")
    own = set(_own_sockets())
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


def _own_sockets():
    for name in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{name}")
        except OSError:  # That of the listing itself.
            continue
        if target.startswith("socket:["):
            yield target[len("socket:[") : -1]
