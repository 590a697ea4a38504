"""Offline: runs a program on a machine without a network, and tells whom it tried to reach.

The namespace of the program has loopback alone (``unshare --net``). Two witnesses watch it: an
audit hook in every Python interpreter, and strace, where it is installed, for native code too.
"""

from __future__ import annotations

import ipaddress
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import contact_log

TOOLS = ("unshare", "ip")
"""Programs that make a namespace and its loopback (util-linux, iproute2)."""
ALONE = 'ip link set lo up && exec "$@"'
STRACE = (
    *("strace", "--seccomp-bpf", "--quiet=all", "-f", "-yy", "-s", "200"),
    *("-e", "trace=connect,sendto,sendmsg,sendmmsg,listen", "-e", "signal=none"),
)
NAME_SERVERS = Path("/etc/resolv.conf")
NAMES_OF_HERE = ("localhost", "localhost.localdomain", "ip6-localhost")

_ADDRESS = re.compile(
    r'sin_addr=inet_addr\("([^"]+)"\)|inet_pton\(AF_INET6, "([^"]+)"|sa_family=AF_(?:VSOCK|PACKET)'
)
_LISTENING = re.compile(r"listen\(\d+<TCP(?:v6)?:\[(.+):\d+\]>")


@dataclass(frozen=True)
class Watched:
    """A program that has ended, and what the witnesses have seen."""

    code: int
    said: str
    """Output and messages of the command."""
    reached: tuple[str, ...]
    """Hosts beyond this machine that it tried to reach, or whose names it asked for."""
    open_to: tuple[str, ...]
    """Addresses beyond loopback that it listened on."""


def refusal() -> str:
    """The reason why nothing can be run offline here; empty if it can."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        return f"{', '.join(missing)} is missing (util-linux, iproute2)"
    tried = ("unshare", "--net", "ip", "link", "set", "lo", "up")
    if subprocess.run(tried, capture_output=True, check=False).returncode:
        return "namespaces of the network need root"
    return ""


def has_strace() -> bool:
    """True if native code is watched too: strace is there, and may trace."""
    if shutil.which("strace") is None:
        return False
    return not subprocess.run((*STRACE, "true"), capture_output=True, check=False).returncode


def run_offline(
    command: Sequence[str], folder: Path, variables: Mapping[str, str] | None = None
) -> Watched:
    """Run a program to its end, without a network.

    Args:
        command: the program and its arguments.
        folder: where it works; its traces and a home of its own are put there.
        variables: environment variables besides those of this process.
    """
    hooks, contacts, calls = folder / ".hooks", folder / ".contacts", folder / ".calls"
    for path in (hooks, folder / ".home"):
        path.mkdir(exist_ok=True)
    for path in (contacts, calls):
        path.unlink(missing_ok=True)
    shutil.copy(contact_log.__file__, hooks / "sitecustomize.py")
    environment = {**os.environ, contact_log.LOG: str(contacts), "HOME": str(folder / ".home")}
    environment |= {"PYTHONPATH": str(hooks), "no_proxy": "*", **(variables or {})}
    traced = (*STRACE, "-o", str(calls), *command) if has_strace() else tuple(command)
    done = subprocess.run(
        ("unshare", "--net", "sh", "-c", ALONE, "sh", *traced),
        cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        errors="replace", check=False,
    )  # fmt: skip
    return Watched(
        done.returncode,
        done.stdout + done.stderr,
        tuple(
            sorted({_told(host) for host in (*_asked(_lines(contacts)), *_called(_lines(calls)))})
        ),
        tuple(sorted(set(_opened(_lines(calls))))),
    )


def is_here(host: str) -> bool:
    """True for loopback and its names."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0].strip("[]"))
    except ValueError:
        return host in NAMES_OF_HERE
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback


def _told(host: str) -> str:
    """The host as a record names it: a name server has another address on every machine."""
    servers = re.findall(r"^nameserver\s+(\S+)", "\n".join(_lines(NAME_SERVERS)), re.M)
    return "the name server" if host in servers else host


def _asked(lines: Sequence[str]) -> Iterator[str]:
    """Hosts elsewhere that the audit hook has seen."""
    hosts = (line.partition(" ")[2] for line in lines)
    return (host for host in hosts if not is_here(host))


def _called(lines: Sequence[str]) -> Iterator[str]:
    """Hosts elsewhere that strace has seen in a call."""
    for line in lines:
        for found in _ADDRESS.finditer(line):
            host = found[1] or found[2] or found[0]
            if not is_here(host):
                yield host


def _opened(lines: Sequence[str]) -> Iterator[str]:
    """Addresses beyond loopback that strace has seen a program listen on."""
    found = (_LISTENING.search(line) for line in lines)
    return (match[1] for match in found if match and not is_here(match[1]))


def _lines(path: Path) -> list[str]:
    return path.read_text(errors="replace").splitlines() if path.exists() else []
