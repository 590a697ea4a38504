"""Execution: options of verbs that do many jobs, and the executor that they name."""

from __future__ import annotations

from collections.abc import Mapping
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
    on this machine only; HOST:PORT: that cluster."""


@dataclass(kw_only=True)
class JobOptions:
    """Resources of one job."""

    cpus: float | None = None
    """Cores (and threads) per job; none: simultaneous jobs share the cores of a machine."""
    gpus: float | None = None
    """GPUs per job, with executor=ray; 0.5 lets two jobs share one; none: one, if there are any."""
    memory_mb: float = 0.0
    """Main memory that a job needs, in megabytes, with executor=ray; 0: any."""


@dataclass(kw_only=True)
class CpuJobOptions:
    """Resources of one job of executor=ray, which uses no GPU."""

    cpus: float | None = None
    """Cores (and threads) per job, with executor=ray; none: one."""
    memory_mb: float = 0.0
    """Main memory that a job needs, in megabytes, with executor=ray; 0: any."""


@dataclass(kw_only=True)
class ExecutorOptions(Options):
    """Options of a verb whose work can be divided among machines."""

    executor: Literal["local", "ray"] = "local"
    """Place of the computation: local (this machine), or ray (the machines of a Ray cluster)."""
    ray: RayOptions = field(default_factory=RayOptions)
    """The cluster of executor=ray."""


@dataclass(kw_only=True)
class ExecutionOptions(ExecutorOptions):
    """Options of a verb that does many jobs."""

    job: JobOptions = field(default_factory=JobOptions)
    """Resources of one job."""


@dataclass(kw_only=True)
class CpuExecutionOptions(ExecutorOptions):
    """Options of a verb that is jobs with executor=ray alone, and on CPUs."""

    job: CpuJobOptions = field(default_factory=CpuJobOptions)
    """Resources of one job."""


def resources_of(options: ExecutionOptions) -> Resources:
    """The resources of each job.

    Raises:
        ConfigError: a value is impossible, or means nothing with the executor.
    """
    from gsfw.jobs.job import Resources

    job = options.job
    _check_least(job.cpus, job.gpus, job.memory_mb)
    _refuse_here(options, {"job.gpus": job.gpus is not None, "job.memory_mb": job.memory_mb > 0})
    return Resources(job.cpus, job.gpus, round(job.memory_mb * MEGABYTE))


def cpu_resources_of(options: CpuExecutionOptions) -> Resources:
    """The resources of each job of executor=ray, with a number of cores and no GPU.

    Raises:
        ConfigError: as of ``resources_of``.
    """
    from gsfw.jobs.job import Resources

    job = options.job
    _check_least(job.cpus, None, job.memory_mb)
    given = {"job.cpus": job.cpus is not None, "job.memory_mb": job.memory_mb > 0}
    _refuse_here(options, given)
    return Resources(job.cpus or 1.0, 0.0, round(job.memory_mb * MEGABYTE))


def _check_least(cpus: float | None, gpus: float | None, memory_mb: float) -> None:
    from gsfw.core.errors import ConfigError

    for name, value, least in (
        ("cpus", cpus, 0.01),
        ("gpus", gpus, 0.0),
        ("memory_mb", memory_mb, 0.0),
    ):
        if value is not None and not value >= least:
            raise ConfigError(f"job.{name}={value:g}: expected {least:g} or more.")


def _refuse_here(options: ExecutorOptions, given: Mapping[str, bool]) -> None:
    """Refuse keys that need Ray, where work stays on this machine."""
    from gsfw.core.errors import ConfigError

    address = options.ray.address
    for name, is_given in {**given, f"ray.address={address}": address != "auto"}.items():
        if options.executor == "local" and is_given:
            raise ConfigError(
                f"{name} has no effect with executor=local, where jobs share this machine.",
                "Add executor=ray, or leave it out.",
            )


def executor_of(options: ExecutorOptions, jobs: int, lock: int | None = None) -> Executor:
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
