"""RayExecutor: jobs on the machines of a Ray cluster."""

from __future__ import annotations

from gsfw.jobs.executor import Executor, StartedJob, end_all
from gsfw.jobs.job import Job, Resources
from gsfw.jobs.ray.cluster import Cluster, connect, load_ray
from gsfw.jobs.ray.remote_job import RemoteJob


class RayExecutor(Executor):
    """Jobs on the machines of a Ray cluster; Ray chooses the machine of each."""

    def __init__(self, address: str = "auto", jobs: int = 0) -> None:
        """Connect to the cluster.

        Args:
            address: ``auto`` for the cluster that RAY_ADDRESS names or that this machine is part
                of, ``local`` to start one of this machine alone, or HOST:PORT.
            jobs: most at a time; 0 for as many as there is room for.

        Raises:
            ConfigError: the address is none.
            UnavailableError: Ray is not installed, or there is no cluster.
        """
        self._connected = connect(address)
        self._cluster = Cluster(jobs)
        self._started: list[RemoteJob] = []

    def places(self, resources: Resources) -> int:
        """The number of jobs of such resources that can be at work at the same time.

        Raises:
            UnavailableError: no machine has them.
        """
        return self._cluster.places(resources)

    def start(self, job: Job) -> StartedJob:
        """Give a job to a machine that has room for it.

        Raises:
            UnavailableError: no machine has its resources.
        """
        self._cluster.places(job.resources)
        self._started = [item for item in self._started if item.is_running]
        started = RemoteJob(job, self._cluster.settle(job.resources))
        self._started.append(started)
        return started

    def close(self) -> None:
        """End all jobs, and leave the cluster; one that was started for this program ends."""
        end_all(item for item in self._started if item.is_running)
        if self._connected:
            load_ray().shutdown()
