"""NodeJob: one job on a machine of the cluster; Ray makes an actor of it there."""

from __future__ import annotations

import os
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from gsfw.jobs import guard
from gsfw.jobs.executor import POLL_SECONDS
from gsfw.jobs.job import Job
from gsfw.jobs.moved_job import moved
from gsfw.jobs.outcome import Outcome
from gsfw.jobs.packed_folder import pack, unpack
from gsfw.jobs.process import JobProcess

GUARD = (sys.executable, "-S", guard.__file__)
"""Ends a job when Ray ends the process that has started it, for example with a lost driver."""


def version() -> str:
    """The version of gsfw that is installed on this machine."""
    return metadata.version("gsfw")


@dataclass(frozen=True)
class Place:
    """The machine that a job has come to."""

    host: str
    version: str
    """Version of gsfw there."""
    is_shared: bool
    """True if it sees the job's folder."""
    missing: tuple[str, ...]
    """Paths that the job reads and that are not there."""


class NodeJob:
    """A job on this machine; its methods are called from another one."""

    def __init__(self) -> None:
        self._process: JobProcess | None = None
        self._stopping = threading.Event()
        self._pieces: Iterator[bytes] = iter(())
        self._own: Path | None = None

    def look(self, reads: tuple[Path, ...], mark: Path | None) -> Place:
        """Tell what this machine sees.

        Args:
            reads: paths that a job needs here.
            mark: a file that was just made beside the job's folder; ``None`` without a folder.
        """
        missing = tuple(str(path) for path in reads if not path.exists())
        is_shared = mark is None or mark.exists()
        return Place(socket.gethostname(), version(), is_shared, missing)

    def work(
        self, job: Job, threads: int, environment: Mapping[str, str], pieces: list[bytes] | None
    ) -> Outcome:
        """Do a job to its end.

        Args:
            job: to do or to continue.
            threads: that it may use.
            environment: variables of the machine that has sent it.
            pieces: its packed folder, where this machine does not see it; empty for a new one.
        """
        os.environ.update(environment)
        if pieces is not None:
            self._own = Path(tempfile.mkdtemp(prefix="gsfw-job-"))
            job = moved(job, self._own / "folder")
            if pieces and job.folder is not None:
                unpack(pieces, job.folder)
        self._process = process = JobProcess(job, threads, before=GUARD)
        if self._stopping.is_set():
            process.stop()
        while (outcome := process.poll()) is None:
            time.sleep(POLL_SECONDS)
        if self._own is not None and job.folder is not None and job.folder.is_dir():
            self._pieces = pack(job.folder)
        return outcome

    def piece(self) -> bytes:
        """The next piece of the folder that the job has written here; empty after the last one."""
        found = next(self._pieces, b"")
        if not found and self._own is not None:
            shutil.rmtree(self._own, ignore_errors=True)
        return found

    def stop(self, once_more: bool) -> None:
        """Ask the job to end with a checkpoint; once more, to end at once."""
        self._stopping.set()
        if self._process is not None:
            self._process.stop(once_more)
