"""Atomic writes: a file has its old or its new content at every moment."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from typing import BinaryIO
from uuid import uuid4

from gsfw.core.errors import OutputError

if sys.platform != "win32":
    import fcntl

NOT_WRITABLE = (
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOTDIR,
    errno.ENOENT,
    errno.EEXIST,
    errno.ENAMETOOLONG,
    errno.EISDIR,
    errno.ELOOP,
)
"""System errors of an unusable place.

EEXIST: a file is in the place of a folder. EISDIR: a folder is in that of a file. ELOOP: links lead
to each other.
"""


WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""System errors of a disk on which nothing can be locked."""
TAKEN = (
    errno.EWOULDBLOCK,
    errno.EEXIST,
    errno.ENOENT,
    errno.EACCES,
    errno.EPERM,
    errno.ELOOP,
)
"""System errors of a partial file that another process writes, or that is another user's."""
WITHOUT_SYNC = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EBADF)
"""System errors of a disk whose folders cannot be synchronised."""
MODE = 0o666
"""Permissions of a new file, from which the system takes those of the umask. A process can only
read its umask by changing it, also for its other threads."""
PARTIAL = ".part"
"""End of the name of a file that is being written; the name begins with a dot."""


def _numbers(*names: str) -> tuple[int, ...]:
    """System errors by their names, as far as this system has them."""
    return tuple(getattr(errno, name) for name in names if hasattr(errno, name))


FAILED = _numbers("EIO", "ESTALE", "ENODEV", "ENXIO", "EREMOTEIO", "ENOMEDIUM")
"""System errors of a disk that fails."""
UNREACHABLE = _numbers("ENOTCONN", "EHOSTDOWN", "EHOSTUNREACH", "ETIMEDOUT")
"""System errors of a disk on another machine that is out of reach; without a file, those of a
connection."""

PLACE = "another place with out=DIR"
"""Remedy of most verbs for a place that cannot be written to."""


@contextmanager
def suppress_errors(*numbers: int) -> Iterator[None]:
    """Suppress some errors of the system, by their numbers."""
    try:
        yield
    except OSError as error:
        if error.errno not in numbers:
            raise


@contextmanager
def other_place(remedy: str) -> Iterator[None]:
    """Let the advice of write errors name the argument that chooses the place.

    Args:
        remedy: what else to choose, such as "another place for OUT".

    Raises:
        OutputError: in place of the one inside the block.
    """
    try:
        yield
    except OutputError as error:
        raise OutputError(error.message, error.advice.replace(PLACE, remedy)) from error


@contextmanager
def readable_write_errors(path: Path) -> Iterator[None]:
    """Turn the system's write errors into one clear message.

    Raises:
        OutputError: the disk is full or fails, or the place is not writable.
    """
    try:
        yield
    except OSError as error:
        clear = write_error(error, path)
        if clear is None:
            raise
        raise clear from error


def write_error(error: OSError, path: Path) -> OutputError | None:
    """The clear message for a write error of the system; ``None`` for another kind of error."""
    if error.errno in NOT_WRITABLE:
        said = os.strerror(error.errno or 0)
        return OutputError(f"{path} cannot be written: {said}.", f"Choose {PLACE}.")
    return disk_error(error, path)


def disk_error(error: BaseException, path: Path | None = None) -> OutputError | None:
    """The clear message for a disk that is full, fails or takes no larger file, else ``None``.

    Args:
        error: of the system, while something was written or read.
        path: the file; ``None`` for the one that the error names.
    """
    if not isinstance(error, OSError):
        return None
    place = path or error.filename
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return OutputError(
            f"the disk is full: {place or 'a file'} could not be written.",
            f"Free some space, or choose {PLACE}.",
        )
    if error.errno == errno.EFBIG:
        return OutputError(
            f"{place or 'a file'} is larger than its disk or a limit (ulimit -f) allows.",
            f"Raise the limit, or choose {PLACE}.",
        )
    if error.errno in FAILED or (place and error.errno in UNREACHABLE):
        return OutputError(
            f"the disk{f' of {place}' if place else ''} fails: {os.strerror(error.errno or 0)}.",
            f"Check the disk and its connection, or choose {PLACE}.",
        )
    return None


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing so that at every moment the old or the complete new one exists.

    The file may be written part by part, and positions in it may be revisited (``seek``). An error
    inside the block leaves the old file, if any, untouched, and no new folder. After the block the
    new file is on the disk: a power loss does not undo it. The partial file of a process that was
    killed is removed by the next one that writes the file.

    Raises:
        OutputError: it cannot be written.
    """
    with readable_write_errors(path), without_new_folders(path.parent):
        make_folder(path.parent)
        handle, name = _partial_file(path)
        try:
            with os.fdopen(handle, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
                if os.name != "nt":  # The lock is held until the file has its name.
                    os.replace(name, path)
            if os.name == "nt":
                os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        keep_names(path.parent)


def _partial_file(path: Path) -> tuple[int, str]:
    """A new file beside ``path`` that no other process writes: handle and name.

    Its name is always the same, so that killed processes leave one at most. While another process
    writes the same file, and where files cannot be locked, it is a random one.
    """
    name = f"{path.parent / f'.{path.name}'}{PARTIAL}"
    if sys.platform != "win32":
        with suppress_errors(*TAKEN, *WITHOUT_LOCKS):
            with suppress_errors(errno.ENOENT):
                # The file of a killed process has the permissions of that one.
                left = _locked(name)
                try:
                    os.unlink(name)
                finally:
                    os.close(left)
            return _locked(name, os.O_CREAT | os.O_EXCL), name
    name = f"{path.parent / f'.{path.name}'}.{uuid4().hex}"
    return os.open(
        name, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), MODE
    ), name


if sys.platform != "win32":

    def _locked(name: str, flags: int = 0) -> int:
        """A partial file that this process alone has open for writing.

        Raises:
            OSError: it cannot be opened or locked, or another process has just removed it.
        """
        handle = os.open(name, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, MODE)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not os.path.samestat(os.fstat(handle), os.lstat(name)):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), name)
        except BaseException:
            os.close(handle)
            raise
        return handle


def make_folder(folder: Path) -> None:
    """Create a folder and its parents, so that a power loss does not undo it.

    Raises:
        OSError: it cannot be created.
    """
    new = [item for item in (folder, *folder.parents) if not item.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for item in reversed(new):
        keep_names(item.parent)


def keep_names(folder: Path) -> None:
    """Bring the names in a folder to the disk; they are not part of the files.

    Raises:
        OSError: the disk has failed.
    """
    if os.name == "nt":  # It has no such call.
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress_errors(*WITHOUT_SYNC):
            os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def without_new_folders(folder: Path) -> Iterator[None]:
    """After an error, remove a folder and its parents as far as they are new and empty."""
    new = [item for item in (folder, *folder.parents) if not item.exists()]
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for item in new:
                item.rmdir()
        raise


@contextmanager
def folder_or_nothing(folder: Path) -> Iterator[None]:
    """After an error, remove a folder with all of its files, unless it was there before.

    Raises:
        OutputError: in place of an ``OSError``.
    """
    with readable_write_errors(folder), without_new_folders(folder.parent):
        is_new = not folder.exists()
        try:
            yield
        except BaseException:
            if is_new:
                rmtree(folder, ignore_errors=True)
            raise


def write_atomically(path: Path, content: bytes) -> None:
    """Write a whole file, as ``atomic_file`` does.

    Raises:
        OutputError: it cannot be written; the old file, if any, is untouched.
    """
    with atomic_file(path) as file:
        file.write(content)
