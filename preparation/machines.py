"""Machines: those of a cluster that find and match features, for the one that keeps the results."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from gsfw.core.callback import Control
from gsfw.core.errors import UnavailableError
from gsfw.jobs.executor import Executor, outcomes
from gsfw.jobs.job import Call, Job, Resources
from gsfw.preparation.native import load_colmap
from gsfw.preparation.sift import ERRORS

Item = TypeVar("Item")

CUT_OFF = (
    "The same command continues with what is not done. If memory has run out there, "
    "job.memory_mb=N keeps N megabytes for each job, and feature_size=1000 needs less."
)


@dataclass(frozen=True)
class Machines:
    """Machines that do jobs, each of which finds or matches the features of some images."""

    executor: Executor
    resources: Resources
    """Resources of each job; the number of cores is given."""

    @property
    def threads(self) -> int:
        """Threads of a job."""
        return max(1, int(self.resources.cpus or 1))

    @property
    def cores(self) -> int:
        """Cores of all jobs that can be at work at the same time.

        Raises:
            UnavailableError: no machine has the resources of a job.
        """
        return self.executor.places(self.resources) * self.threads

    def parts(self, items: Sequence[Item], most: int) -> Iterator[Sequence[Item]]:
        """Cut work into even parts of one job each, so many that all machines end together.

        Args:
            items: all of it.
            most: items of a part, at most, for each thread of a job.

        Raises:
            UnavailableError: no machine has the resources of a job.
        """
        if not items:
            return
        places = self.executor.places(self.resources)
        rounds = math.ceil(len(items) / (most * self.threads * places))
        size = max(1, math.ceil(len(items) / max(1, rounds * places)))
        for first in range(0, len(items), size):
            yield items[first : first + size]

    def job(
        self,
        name: str,
        function: Callable[..., Any],
        *arguments: object,
        reads: Iterable[Path] = (),
    ) -> Job:
        """A job that calls a function on a machine where pycolmap is the same as here.

        Args:
            name: of the work in words, for messages.
            function: that other processes can import.
            arguments: that can be pickled.
            reads: absolute paths of files that have to be there, too.
        """
        import pycolmap

        work = Call(_call, (pycolmap.__version__, function, *arguments))
        return Job(name, work, self.resources, tuple(reads))

    def values(self, jobs: Iterable[Job]) -> Generator[Any, None, None]:
        """Do jobs; yields the value of each when it has ended, in the order of their ends.

        Jobs end with this iterator, also where it is closed before they have.

        Raises:
            UnavailableError: a job has failed, or no machine has its resources.
        """
        # Closed at once, and not when the last reference to it goes: it holds jobs.
        with closing(outcomes(self.executor, jobs, Control())) as ended:
            for job, outcome in ended:
                if not outcome.finished:
                    advice = CUT_OFF if outcome.resumable else outcome.advice
                    raise UnavailableError(f"{job.name}: {outcome.error}", advice)
                yield outcome.value


def _call(version: str, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    """Call a function on the machine of a job.

    Raises:
        UnavailableError: pycolmap is missing there, or of another version.
    """
    here = socket.gethostname()
    try:
        load_colmap()
    except (ImportError, RuntimeError) as error:
        raise UnavailableError(
            f"pycolmap cannot be loaded on {here}: {error}.",
            "Install it anew there with: pip install --force-reinstall 'pycolmap>=4.2'",
        ) from error
    import pycolmap

    if pycolmap.__version__ != version:
        raise UnavailableError(
            f"pycolmap is {pycolmap.__version__} on {here}, and {version} here.",
            f"Install the same version on every machine: pip install 'pycolmap=={version}'",
        )
    pycolmap.logging.minloglevel = ERRORS
    return function(*arguments)
