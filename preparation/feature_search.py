"""Feature search: features of many images, by processes of this machine or jobs on others."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing import resource_tracker

from gsfw.core.errors import UnavailableError
from gsfw.jobs.job import Job
from gsfw.preparation.machines import Machines
from gsfw.preparation.sift import ImageFeatures, ImageTask, find_features, start_worker

WORKER_SECONDS = 2.0
"""Time for a process to start: work that takes less than twice as long is done in this one."""
JOB_IMAGES = 32
"""Images of a job for each of its threads: 10 to 60 seconds, where starting a job takes a few."""


def find_all(
    tasks: Sequence[ImageTask], jobs: int, each: float, machines: Machines | None = None
) -> Generator[ImageFeatures, None, None]:
    """Features of images, each as soon as it is there; the result does not depend on the place.

    Processes and jobs end with this generator, also where it is closed before they have.

    Args:
        tasks: images, at absolute paths.
        jobs: processes of this machine.
        each: about the seconds of an image.
        machines: those that look for features, instead of processes of this one.

    Raises:
        UnavailableError: a process was ended from outside, or a job has failed.
    """
    if machines is None:
        return _find_here(tasks, jobs, each)
    return _find_there(tasks, each, machines)


def _find_there(
    tasks: Sequence[ImageTask], each: float, machines: Machines
) -> Generator[ImageFeatures, None, None]:
    """Features in the order in which jobs end."""

    def job(part: Sequence[ImageTask]) -> Job:
        paths = [task.path for task in part]
        name = f"features of {len(part)} image{'s' if part[1:] else ''}"
        return machines.job(name, _find_part, part, machines.threads, each, reads=paths)

    with closing(machines.values(map(job, machines.parts(tasks, JOB_IMAGES)))) as parts:
        for found in parts:
            yield from found


def _find_part(tasks: Sequence[ImageTask], jobs: int, each: float) -> list[ImageFeatures]:
    """The features of a job's images, on its machine."""
    with closing(_find_here(tasks, jobs, each)) as results:
        return list(results)


def _find_here(
    tasks: Sequence[ImageTask], jobs: int, each: float
) -> Generator[ImageFeatures, None, None]:
    """Features in the order of the tasks."""
    if jobs == 1 or each * len(tasks) < 2 * WORKER_SECONDS:
        yield from map(find_features, tasks)
        return
    with _workers(min(jobs, len(tasks))) as executor:
        with _deaf_to_interrupts():
            waiting = deque(executor.submit(find_features, task) for task in tasks)
        while waiting:
            yield waiting.popleft().result()


@contextmanager
def _workers(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that are ended at once where work is broken off.

    Processes, as COLMAP does not let go of the interpreter while it finds features of an array;
    spawned ones, as a forked one may hold a lock that none of its threads will ever release.
    """
    others = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), start_worker)
    try:
        yield executor
    except BaseException as error:
        # Nothing is cancelled: Python 3.11 fails on cancelled work of ended processes.
        executor.shutdown(wait=False)
        for worker in set(multiprocessing.active_children()) - others:
            # COLMAP prints a stack trace when it is asked to terminate.
            worker.kill()
        if isinstance(error, BrokenProcessPool):
            raise UnavailableError(
                f"one of {jobs} processes that look for features was ended from outside, most "
                "likely because memory ran out.",
                "Run the same command again with fewer processes (jobs=1): it continues with the "
                "images that are not done. If that does not help, look on smaller images "
                "(feature_size=1000).",
            ) from error
        raise
    executor.shutdown()


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes that are started here get no Ctrl-C from their first instruction on.

    This process gets it afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows: processes inherit nothing of it.
        yield
        return
    resource_tracker.ensure_running()  # Its start would end the blocking.
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    # Signals that this thread blocks come to another one, and are handled in the main thread.
    handler = (
        signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if is_main else None
    )
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if is_main:
            signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)
