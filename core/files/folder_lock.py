"""Folder lock: restricts a folder to one program at a time.

The system's lock on a file decides: it ends with its process, however that ended, so nothing stale
is left behind. NFS and SMB carry it to other machines. On a disk without such locks a file decides
that only one process can create; it may outlive its process, so that its owner is looked for.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import WITHOUT_LOCKS, make_folder, readable_write_errors
from gsfw.core.files.json_text import parsed_json

if sys.platform != "win32":
    import fcntl

LOCK = ".lock"
"""Name of the locked file, which names its owner; it is kept, and marks the folder as gsfw's."""
CLAIM = ".lock-owner"
"""Name of the file that only one process can create, on disks without locks."""
FAR = 1 << 30
"""Byte that is locked on Windows, where a locked byte cannot be read: the content is before it."""
ATTEMPTS = 100
"""Most times that a lock is asked for again, because its folder was removed meanwhile."""
REMEDY = "Wait for it, end it, or choose another folder with out=DIR."


@dataclass(frozen=True)
class Owner:
    """The process that holds a folder."""

    pid: int
    host: str
    since: str
    """Time of its claim, UTC."""

    @staticmethod
    def this() -> Owner:
        """This process, now."""
        now = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
        return Owner(os.getpid(), socket.gethostname(), now)

    @staticmethod
    def read(path: Path) -> Owner | None:
        """The owner that a file names; ``None`` if it names none (yet)."""
        try:
            return Owner(**parsed_json(path.read_text("utf-8")))
        except (OSError, ValueError, TypeError):
            return None

    @property
    def is_gone(self) -> bool:
        """True if it was a process of this machine, and there is no such process any more."""
        if self.host != socket.gethostname() or sys.platform == "win32":
            return False
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return True
        except OSError:  # It is another user's.
            return False
        return False

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.since}"

    def encoded(self) -> bytes:
        """The content of a file that names it."""
        return json.dumps(asdict(self)).encode()


@contextmanager
def only_one(folder: Path, others: str, remedy: str = REMEDY) -> Iterator[int]:
    """Lock a folder; yields the open lock for child processes.

    A process that inherits the lock and outlives its parent still holds it.

    Args:
        folder: created if it is missing.
        others: description of the excluded programs for messages, such as "another study".
        remedy: advice where one of them is at work.

    Raises:
        OutputError: another program has the lock, or the folder cannot be written to.
    """
    handle = _taken(folder, others, remedy)
    owner = Owner.this()
    _name_owner(handle, owner.encoded())
    try:
        yield handle
    finally:
        _name_owner(handle, b"")
        with suppress(OSError):  # The error of a disk that fails is told by what has failed.
            os.close(handle)
        claim = Owner.read(folder / CLAIM)
        if claim is not None and (claim.pid, claim.host) == (owner.pid, owner.host):
            (folder / CLAIM).unlink(missing_ok=True)


def holder(folder: Path) -> Owner | None:
    """The process that has the lock of a folder; ``None`` if nobody has it.

    A lock is tried only where a process is named: one that was killed has named itself too.
    """
    claim = Owner.read(folder / CLAIM)
    if claim is not None and not claim.is_gone:
        return claim
    owner = Owner.read(folder / LOCK)
    if owner is None or owner.is_gone:
        return None
    with suppress(OSError):
        handle = os.open(folder / LOCK, os.O_RDWR)
        try:
            return None if _lock(handle) else owner
        except BlockingIOError:
            return owner
        finally:
            os.close(handle)
    return owner


def _name_owner(handle: int, content: bytes) -> None:
    """Write who has the lock, which only messages need: a full disk does not matter."""
    with suppress(OSError):
        os.truncate(handle, 0)
        os.write(handle, content)


def _taken(folder: Path, others: str, remedy: str) -> int:
    """The open file of the lock of a folder, once this process has it.

    Raises:
        OutputError: as of ``only_one``.
    """
    for _ in range(ATTEMPTS):
        with readable_write_errors(folder):
            make_folder(folder)
            with suppress(FileNotFoundError):
                handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
                try:
                    if not _lock(handle):
                        _claim(folder / CLAIM)
                    if os.path.samestat(os.fstat(handle), os.stat(folder / LOCK)):
                        return handle
                except BlockingIOError:
                    os.close(handle)
                    owner = Owner.read(folder / LOCK) or Owner.read(folder / CLAIM)
                    by = f" ({owner})" if owner and not owner.is_gone else ""
                    raise OutputError(f"{folder}: {others} is at work there{by}.", remedy) from None
                except BaseException:
                    os.close(handle)
                    raise
                os.close(handle)
        # Another program has given up and removed the folder, and with it the opened file.
    raise OutputError(f"{folder} cannot be locked: it is removed again and again.", remedy)


def _lock(handle: int) -> bool:
    """Lock an open file; false where the disk has no locks.

    Raises:
        BlockingIOError: another process has locked it.
    """
    if sys.platform == "win32":
        import msvcrt

        os.lseek(handle, FAR, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(error.errno, error.strerror) from error
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in WITHOUT_LOCKS:
            return False
        raise
    return True


def _claim(path: Path) -> None:
    """Create the file that only one process can create; replace that of a process that is gone.

    Raises:
        BlockingIOError: another process has created it.
    """
    if (owner := Owner.read(path)) is not None and owner.is_gone:
        aside = path.with_name(f"{path.name}.{os.getpid()}")
        with suppress(FileNotFoundError):
            path.rename(aside)  # Of several processes that see it, one succeeds.
            if Owner.read(aside) != owner:  # It was replaced already: put the new one back.
                with suppress(FileExistsError):
                    os.link(aside, path)
            aside.unlink()
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    except FileExistsError as error:
        raise BlockingIOError(error.errno, error.strerror) from error
    with os.fdopen(handle, "wb") as file:
        file.write(Owner.this().encoded())
