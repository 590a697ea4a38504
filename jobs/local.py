"""LocalExecutor: jobs in processes of this machine."""

from __future__ import annotations

from gsfw.core.cores import chosen_threads, cores
from gsfw.jobs.executor import Executor, StartedJob, end_all
from gsfw.jobs.job import Job, Resources
from gsfw.jobs.outcome import Outcome
from gsfw.jobs.process import JobProcess


class LocalJob(StartedJob):
    """A job in a process of this machine."""

    def __init__(self, process: JobProcess) -> None:
        self.job, self._process = process.job, process

    @property
    def seconds(self) -> float:
        """Since it was started."""
        return self._process.seconds

    @property
    def is_running(self) -> bool:
        """True if it has not ended."""
        return self._process.is_running

    def poll(self) -> Outcome | None:
        """The outcome; ``None`` while the process runs."""
        return self._process.poll()

    def stop(self, once_more: bool = False) -> None:
        """Ask the process to end with a checkpoint; once more, to end at once."""
        self._process.stop(once_more)

    def wait(self) -> None:
        """Wait until the process has ended; kill it after some time."""
        self._process.wait()


class LocalExecutor(Executor):
    """Jobs in processes of this machine, whose GPUs and memory all of them share."""

    def __init__(self, jobs: int = 1, lock: int | None = None) -> None:
        """Start nothing yet.

        Args:
            jobs: at a time.
            lock: an open file that every process holds as long as it lives.
        """
        self._jobs, self._lock = jobs, lock
        self._started: list[LocalJob] = []

    def places(self, resources: Resources) -> int:
        """The number of jobs at a time, whatever they need."""
        return self._jobs

    def start(self, job: Job) -> StartedJob:
        """Start a process, with its part of the cores unless the job says how many."""
        cpus = job.resources.cpus
        threads = threads_per_job(self._jobs) if cpus is None else max(1, int(cpus))
        started = LocalJob(JobProcess(job, threads, self._lock))
        self._started.append(started)
        return started

    def close(self) -> None:
        """End all processes."""
        end_all(item for item in self._started if item.is_running)


def threads_per_job(jobs: int) -> int | None:
    """Threads of each of several jobs at a time; ``None`` leaves a single one as it is."""
    if jobs == 1:
        return None
    return max(1, (chosen_threads() or cores()) // jobs)
