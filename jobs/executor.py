"""Executor: does jobs in processes of this machine or of others, and reports their ends."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable
from types import TracebackType

from gsfw.core.callback import Control
from gsfw.jobs.job import Job, Resources
from gsfw.jobs.outcome import Outcome

POLL_SECONDS = 0.1
"""Between looks at jobs; next to nothing against the length of a job."""


class StartedJob(ABC):
    """A job that was given to an executor."""

    job: Job

    @property
    @abstractmethod
    def seconds(self) -> float:
        """Since it was given to the executor."""

    @abstractmethod
    def poll(self) -> Outcome | None:
        """The outcome; ``None`` while the job is at work.

        Work on a machine that died is started again on another one meanwhile.
        """

    @abstractmethod
    def stop(self, once_more: bool = False) -> None:
        """Ask the job to end with a checkpoint; once more, to end at once."""

    @abstractmethod
    def wait(self) -> None:
        """Wait until a job that was asked to end has ended; end it by force if it does not."""


class Executor(ABC):
    """Does jobs; used as a context, at whose end no job is at work any more."""

    @abstractmethod
    def places(self, resources: Resources) -> int:
        """The number of jobs of such resources that can be at work at the same time.

        Raises:
            UnavailableError: no machine has them.
        """

    @abstractmethod
    def start(self, job: Job) -> StartedJob:
        """Give a job to a machine; it waits there where all are busy.

        Raises:
            UnavailableError: no machine has its resources.
        """

    @abstractmethod
    def close(self) -> None:
        """End all jobs, and leave the machines."""

    def __enter__(self) -> Executor:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def end_all(started: Iterable[StartedJob]) -> None:
    """End jobs, all at the same time, and wait for them."""
    at_work = list(started)
    for item in at_work:
        item.stop(once_more=True)
    for item in at_work:
        item.wait()


def outcomes(
    executor: Executor, jobs: Iterable[Job], control: Control
) -> Generator[tuple[Job, Outcome], None, None]:
    """Do all jobs, as many at a time as there are places; yields each when it has ended.

    A requested stop ends jobs with a checkpoint; their outcomes say so, and no further job starts.
    An exception, such as one of the caller's, ends them too.

    Args:
        executor: does them.
        jobs: in the order in which they start; the next one is asked for when one has started,
            so that not all of them have to be in memory.
        control: may request a stop.

    Raises:
        UnavailableError: no machine has the resources of a job.
    """
    waiting, at_work = iter(jobs), list[StartedJob]()
    try:
        following = next(waiting, None)
        while following is not None or at_work:
            if control.stop_reason is not None:
                following = None
                for item in at_work:
                    item.stop()
            while following is not None and len(at_work) < executor.places(following.resources):
                at_work.append(executor.start(following))
                following = next(waiting, None)
            for item in list(at_work):
                outcome = item.poll()
                if outcome is not None:
                    at_work.remove(item)
                    yield item.job, outcome
            if at_work:
                time.sleep(POLL_SECONDS)
    finally:
        end_all(at_work)
