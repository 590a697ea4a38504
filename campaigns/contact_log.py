"""Contact log: notes whom a Python process tries to reach, and which names it asks for.

Copied as ``sitecustomize.py`` into a folder of PYTHONPATH, it is imported when an interpreter
starts, those of child processes too. Without the variable ``LOG`` it does nothing.
"""

from __future__ import annotations

import os
import sys

LOG = "GSFW_CONTACT_LOG"
"""Environment variable: the file that lines are appended to."""
WITH_ADDRESS = {"socket.connect": 1, "socket.sendto": 1, "socket.sendmsg": 1}
"""Events with an address, and its place among their arguments."""
WITH_NAME = {"socket.getaddrinfo": 0, "socket.gethostbyname": 0, "socket.gethostbyaddr": 0}
"""Events with the name of a machine."""


def contact(event: str, arguments: tuple[object, ...]) -> str:
    """A machine that an event of the interpreter is about; empty for none."""
    if event in WITH_NAME:
        name = arguments[WITH_NAME[event]]
        return name.decode(errors="replace") if isinstance(name, bytes) else str(name or "")
    if event in WITH_ADDRESS:
        address = arguments[WITH_ADDRESS[event]]
        # The address of a socket of this machine's files is a text, and not a tuple.
        return str(address[0]) if isinstance(address, tuple) and len(address) > 1 else ""
    return ""


def _note(event: str, arguments: tuple[object, ...]) -> None:
    host = contact(event, arguments)
    if host:
        handle = os.open(os.environ[LOG], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        os.write(handle, f"{event} {host}\n".encode())
        os.close(handle)


if os.environ.get(LOG):
    sys.addaudithook(_note)
