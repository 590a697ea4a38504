"""Execution: options of verbs that do many jobs, and the executor that they name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from gsfw.commands.interface.arguments import Options

if TYPE_CHECKING:
    from gsfw.jobs.executor import Executor
    from gsfw.jobs.job import Resources

MEGABYTE = 1_000_000
"""Bytes, as in cache_mb."""


@dataclass(kw_only=True)
class RayOptions:
    """The cluster of executor=ray."""

    address: str = "auto"
    """auto: the cluster that RAY_ADDRESS names, or that this machine is part of; local: start one
    of this machine alone; HOST:PORT: that cluster."""


@dataclass(kw_only=True)
class JobOptions:
    """Resources of one job."""

    cpus: float | None = None
    """Cores, and threads; none: jobs at a time share the cores of a machine."""
    gpus: float | None = None
    """With executor=ray: GPUs; 0.5 lets two jobs share one; none: one, where there are any."""
    memory_mb: float = 0.0
    """With executor=ray: megabytes of main memory that have to be free for it; 0: any."""


@dataclass(kw_only=True)
class ExecutionOptions(Options):
    """Options of a verb that does many jobs."""

    executor: Literal["local", "ray"] = "local"
    """Machines that do the work: local is this one, ray the machines of a Ray cluster."""
    ray: RayOptions = field(default_factory=RayOptions)
    """The cluster of executor=ray."""
    job: JobOptions = field(default_factory=JobOptions)
    """Resources of one job."""


def resources_of(options: ExecutionOptions) -> Resources:
    """The resources of each job.

    Raises:
        ConfigError: a value is impossible, or means nothing with the executor.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.jobs.job import Resources

    job = options.job
    for name, value, least in (
        ("cpus", job.cpus, 0.01),
        ("gpus", job.gpus, 0.0),
        ("memory_mb", job.memory_mb, 0.0),
    ):
        if value is not None and not value >= least:
            raise ConfigError(f"job.{name}={value:g}: expected {least:g} or more.")
    if options.executor == "local":
        for name, given in (
            ("job.gpus", job.gpus is not None),
            ("job.memory_mb", job.memory_mb > 0),
            (f"ray.address={options.ray.address}", options.ray.address != "auto"),
        ):
            if given:
                raise ConfigError(
                    f"{name} means nothing with executor=local, whose jobs share this machine.",
                    "Add executor=ray, or leave it out.",
                )
    return Resources(job.cpus, job.gpus, round(job.memory_mb * MEGABYTE))


def executor_of(options: ExecutionOptions, jobs: int, lock: int | None = None) -> Executor:
    """The executor that the options name.

    Args:
        options: of the verb.
        jobs: most at a time; 0 for as many as a cluster has resources for.
        lock: an open file that every process of this machine holds as long as it lives.

    Raises:
        UnavailableError: Ray is not installed, or there is no cluster.
    """
    from gsfw.jobs.local import LocalExecutor

    if options.executor == "local":
        return LocalExecutor(max(1, jobs), lock)
    from gsfw.jobs.ray.executor import RayExecutor

    return RayExecutor(options.ray.address, jobs)
