"""RemoteJob: a job that was given to the cluster, seen from the machine that has given it."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.files.folder_lock import holder
from gsfw.jobs.executor import StartedJob
from gsfw.jobs.job import Job, Resources
from gsfw.jobs.moved_job import moved
from gsfw.jobs.outcome import Outcome
from gsfw.jobs.packed_folder import pack, unpack
from gsfw.jobs.process import PATIENCE, is_resumable
from gsfw.jobs.ray.cluster import load_ray
from gsfw.jobs.ray.node import NodeJob, Place, version

ATTEMPTS = 5
"""Machines that may die under a job before it counts as failed: it may be the job that does it."""

LEAVING = 45.0
"""Seconds in which a job on a machine that Ray has lost must have left its folder."""

AT_ONCE = 5.0
"""Seconds for an answer of a machine that is not at work."""

PREFIX = "GSFW_"
"""Variables of the environment that jobs are given."""


class RemoteJob(StartedJob):
    """A job on a machine of the cluster; it is begun again where its machine dies."""

    def __init__(self, job: Job, resources: Resources) -> None:
        """Give it to the cluster.

        Args:
            job: to do or to continue.
            resources: numbers for all.
        """
        self.job, self._resources = job, resources
        folder = None if job.folder is None else job.folder.absolute()
        self._there = job if folder is None else moved(job, folder)
        self._there = replace(self._there, reads=tuple(path.absolute() for path in job.reads))
        self._started = time.monotonic()
        self._attempts = 0
        self._lost_at: float | None = None
        self._asked_to_stop = False
        self._mark: Path | None = None
        self._actor: Any = None
        self._looking: Any = None
        self._working: Any = None
        self._is_shared = True
        self._outcome: Outcome | None = None
        self._begin()

    @property
    def seconds(self) -> float:
        """Since it was given to the cluster."""
        return time.monotonic() - self._started

    @property
    def is_running(self) -> bool:
        """True if its end is not known yet."""
        return self._outcome is None

    def _begin(self) -> None:
        """Ask the cluster for a machine, and the machine for what it sees."""
        ray, asked = load_ray(), self._resources
        self._attempts += 1
        self._lost_at = None
        self._mark = _mark_beside(self._there.folder)
        actor = ray.remote(NodeJob).options(
            num_cpus=asked.cpus,
            num_gpus=asked.gpus,
            memory=asked.memory or None,
            max_concurrency=2,  # One works, the other one hears that it is to stop.
            scheduling_strategy="SPREAD",
        )
        self._actor = actor.remote()
        self._looking = self._actor.look.remote(self._there.reads, self._mark)
        self._working = None

    def poll(self) -> Outcome | None:
        """The outcome; ``None`` while the job waits or is at work."""
        if self._outcome is not None:
            return self._outcome
        try:
            self._outcome = self._progress()
        except load_ray().exceptions.RayActorError as error:
            self._outcome = self._lost(str(error))
        if self._outcome is not None:
            self._leave()
        return self._outcome

    def _progress(self) -> Outcome | None:
        ray = load_ray()
        if self._lost_at is not None:
            return self._begin_again(self._lost_at)
        if self._working is None:
            if not _is_ready(self._looking):
                return None
            place: Place = ray.get(self._looking)
            self._unmark()
            refused = self._refused(place)
            if refused:
                return refused
            self._is_shared = place.is_shared
            self._send()
        if not _is_ready(self._working):
            return None
        try:
            outcome: Outcome = ray.get(self._working)
        except ray.exceptions.RayTaskError as error:
            said = str(error.cause or error).strip().splitlines()
            return Outcome(False, self.seconds, error=f"on its machine: {said[-1]}")
        if not self._is_shared and self._there.folder is not None:
            self._bring_home(self._there.folder)
        return outcome

    def _begin_again(self, lost_at: float) -> Outcome | None:
        """Go on elsewhere, once the lost machine has let go of a folder that is shared."""
        if self._asked_to_stop:
            return Outcome(False, self.seconds, stopped=True)
        folder = self._there.folder
        busy = folder is not None and folder.is_dir() and holder(folder) is not None
        if not busy or time.monotonic() - lost_at > LEAVING:
            self._begin()
        return None

    def _lost(self, said: str) -> Outcome | None:
        """Note that the machine has died, or that Ray has ended its process."""
        self._leave()  # It may only be out of reach.
        if "No module named 'gsfw" in said:
            return Outcome(
                False,
                self.seconds,
                error="a machine of the Ray cluster has no gsfw.",
                advice=f"Install gsfw {version()} in the Python of every machine.",
            )
        if self._asked_to_stop:
            return Outcome(False, self.seconds, stopped=True)
        if self._attempts >= ATTEMPTS:
            return Outcome(
                False,
                self.seconds,
                error=f"{ATTEMPTS} machines or processes of the Ray cluster have died under it.",
                advice="A machine may have run out of memory: job.memory_mb=N keeps N free.",
                resumable=True,
            )
        self._lost_at = time.monotonic()
        return None

    def _refused(self, place: Place) -> Outcome | None:
        """The failure of a job that its machine cannot do."""
        error = advice = ""
        if place.version != version():
            error = f"gsfw is {place.version} on {place.host}, and {version()} here."
            advice = "Install the same version on every machine."
        elif place.missing:
            error = f"{place.host} does not see {place.missing[0]}."
            advice = "Data has to be at the same path on every machine, as on a shared disk."
        return Outcome(False, self.seconds, error=error, advice=advice) if error else None

    def _send(self) -> None:
        """Let the machine work; a folder that it does not see goes there with the job."""
        job, threads = self._there, max(1, int(self._resources.cpus or 1))
        pieces: list[bytes] | None = None
        if not self._is_shared and job.folder is not None:
            pieces = list(pack(job.folder)) if is_resumable(job) else []
        given = {key: value for key, value in os.environ.items() if key.startswith(PREFIX)}
        self._working = self._actor.work.remote(job, threads, given, pieces)
        if self._asked_to_stop:
            self._actor.stop.remote(False)

    def _bring_home(self, folder: Path) -> None:
        """Receive the folder that the job has written."""
        received = self._pieces()
        first = next(received, b"")
        if first:
            unpack(_chained(first, received), folder)

    def _pieces(self) -> Iterator[bytes]:
        while piece := load_ray().get(self._actor.piece.remote()):
            yield piece

    def stop(self, once_more: bool = False) -> None:
        """Ask the job to end with a checkpoint; once more, to end at once."""
        if self._outcome is not None or (self._asked_to_stop and not once_more):
            return
        self._asked_to_stop = True
        if self._working is None:  # It has not begun.
            self._outcome = Outcome(False, self.seconds, stopped=True)
            self._leave()
        else:
            self._actor.stop.remote(once_more)

    def wait(self) -> None:
        """Wait until the job has ended and its files are here; end it by force if it does not."""
        until = time.monotonic() + PATIENCE + AT_ONCE
        while self.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        if self._outcome is None:
            self._outcome = Outcome(False, self.seconds, stopped=True)
            self._leave()

    def _leave(self) -> None:
        """Give the machine back."""
        self._unmark()
        with suppress(load_ray().exceptions.RayError, ValueError):
            load_ray().kill(self._actor)

    def _unmark(self) -> None:
        if self._mark is not None:
            self._mark.unlink(missing_ok=True)
            self._mark = None


def _is_ready(reference: Any) -> bool:  # noqa: ANN401 - Ray's reference to a coming value
    ready, _ = load_ray().wait([reference], timeout=0)
    return bool(ready)


def _chained(first: bytes, rest: Iterator[bytes]) -> Iterator[bytes]:
    yield first
    yield from rest


def _mark_beside(folder: Path | None) -> Path | None:
    """A new file beside a folder, by which a machine can tell that it sees the same disk."""
    if folder is None:
        return None
    mark = folder.parent / f".seen-{uuid.uuid4().hex}"
    with readable_write_errors(mark):
        folder.parent.mkdir(parents=True, exist_ok=True)
        mark.touch()
    return mark
