"""Cluster: the connection to a Ray cluster, and the jobs that its machines have room for."""

from __future__ import annotations

import logging
import math
import os
import platform
import signal
import socket
import tarfile
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.jobs.job import Resources

FRESH = 2.0
"""Seconds for which the list of machines is not asked for again."""

ANSWER = 10.0
"""Seconds for a machine to answer."""

LAST_PORT = 65535

CLUSTERS = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""Variable that lets Ray's processes listen on loopback alone, on Linux too, where it is 0."""

START = "ray start --head makes this machine one, ray.address=local uses this machine alone."


def load_ray() -> ModuleType:
    """Import Ray, which then says nothing by itself.

    Raises:
        UnavailableError: it is not installed, or this Python unpacks no folder of a machine safely.
    """
    if not hasattr(tarfile, "data_filter"):  # Not in 3.10 before 3.10.12, nor 3.11 before 3.11.4.
        raise UnavailableError(
            "executor=ray needs Python 3.10.12, 3.11.4, 3.12 or newer, which refuse archives with "
            f"files outside of their folder; this is Python {platform.python_version()}.",
            "Update Python on all machines of the cluster, or use executor=local.",
        )
    # Both are read when it is imported or when processes are started; a user's own value stays.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "1")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import ray
    except ImportError as error:
        raise UnavailableError(
            f"executor=ray needs Ray, which cannot be imported: {error}.",
            "Install it with: pip install 'gsfw[ray]'",
        ) from error
    return ray


def connect(address: str) -> bool:
    """Connect to a cluster; false if this program was connected already, and stays so.

    Args:
        address: ``auto``, ``local`` or HOST:PORT.

    Raises:
        ConfigError: the address is none.
        UnavailableError: Ray is not installed, or there is no cluster.
    """
    _check(address)
    ray = load_ray()
    if ray.is_initialized():
        return False
    _silence()
    # Ray takes over SIGTERM, which has its meaning here.
    before = signal.getsignal(signal.SIGTERM)
    try:
        within = _on_loopback() if address == "local" else nullcontext()
        with within, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ray.init(
                address=address,
                include_dashboard=False if address == "local" else None,
                logging_level=logging.CRITICAL,
                log_to_driver=False,
            )
    except ConnectionError as error:
        raise _no_cluster(address) from error
    except (RuntimeError, ValueError, ray.exceptions.RayError) as error:
        said = str(error).strip().splitlines()
        raise UnavailableError(
            f"Ray cannot connect to {address}: {said[0] if said else type(error).__name__}",
            _advice(address),
        ) from error
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, before)
    return True


@contextmanager
def _on_loopback() -> Iterator[None]:
    """Let the processes that Ray starts listen on loopback alone; a user's own value stays.

    They listen on every interface otherwise, and run the code of whoever connects to them.
    """
    constants = import_module("ray._private.ray_constants")
    if CLUSTERS in os.environ or not hasattr(constants, "ENABLE_RAY_CLUSTER"):
        yield
        return
    before = constants.ENABLE_RAY_CLUSTER
    os.environ[CLUSTERS] = "0"
    setattr(constants, "ENABLE_RAY_CLUSTER", False)  # noqa: B010
    try:
        yield
    finally:
        setattr(constants, "ENABLE_RAY_CLUSTER", before)  # noqa: B010
        del os.environ[CLUSTERS]


def _silence() -> None:
    """Let Ray not print what happens to machines, for which it has no setting."""
    worker = import_module("ray._private.worker")
    if hasattr(worker, "print_to_stdstream"):
        setattr(worker, "print_to_stdstream", lambda data, ignore_prefix: None)  # noqa: B010


def _advice(address: str) -> str:
    if address == "local":
        return "executor=local needs no Ray."
    return f"Name one with ray.address=HOST:PORT. {START}"


def _check(address: str) -> None:
    if address in ("auto", "local"):
        return
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > LAST_PORT:
        raise ConfigError(
            f"ray.address={address}: expected auto, local or HOST:PORT.",
            "HOST:PORT is what ray start --head prints, such as 10.0.0.1:6379.",
        )
    try:  # Ray would try for minutes.
        socket.create_connection((host, int(port)), ANSWER).close()
    except OSError as error:
        raise _no_cluster(address) from error


def _no_cluster(address: str) -> UnavailableError:
    where = "on this machine" if address == "auto" else f"at {address}"
    return UnavailableError(f"there is no Ray cluster {where}.", _advice(address))


@dataclass(frozen=True)
class Machine:
    """All resources of a machine of the cluster, busy or not."""

    cpus: float
    gpus: float
    memory: float
    """Bytes."""

    @staticmethod
    def of(resources: Mapping[str, float]) -> Machine:
        """The machine of Ray's table of resources."""
        return Machine(
            resources.get("CPU", 0.0), resources.get("GPU", 0.0), resources.get("memory", 0.0)
        )

    def room(self, asked: Resources) -> int:
        """Jobs of settled resources that fit on it together."""
        pairs = ((self.cpus, asked.cpus), (self.gpus, asked.gpus), (self.memory, asked.memory))
        parts = [math.floor(has / wanted + 1e-9) for has, wanted in pairs if wanted]
        return min(parts, default=0)


class Cluster:
    """The machines of the cluster that this program is connected to."""

    def __init__(self, jobs: int) -> None:
        """Look at nothing yet.

        Args:
            jobs: most at a time; 0 for as many as there is room for.
        """
        self._jobs = jobs
        self._settled: dict[Resources, Resources] = {}
        self._machines: tuple[Machine, ...] = ()
        self._seen = -math.inf

    def machines(self) -> tuple[Machine, ...]:
        """All that are alive."""
        if time.monotonic() - self._seen > FRESH:
            nodes: list[dict[str, Any]] = load_ray().nodes()
            self._machines = tuple(Machine.of(node["Resources"]) for node in nodes if node["Alive"])
            self._seen = time.monotonic()
        return self._machines

    def settle(self, asked: Resources) -> Resources:
        """Resources with numbers for all; the same for all jobs, whatever machines come and go.

        Without a number of GPUs it is one, if there are any. Without a number of cores it is the
        part of the smallest machine that goes with the GPUs of the job, or with jobs at a time.
        """
        if asked not in self._settled:
            machines = self.machines()
            gpus = asked.gpus
            if gpus is None:
                gpus = 1.0 if any(machine.gpus >= 1 for machine in machines) else 0.0
            cpus = asked.cpus
            if cpus is None:
                cpus = self._usual_cpus(gpus, machines)
            self._settled[asked] = Resources(cpus, gpus, asked.memory)
        return self._settled[asked]

    def _usual_cpus(self, gpus: float, machines: tuple[Machine, ...]) -> float:
        fitting = [m for m in machines if m.cpus >= 1 and m.gpus >= gpus]
        if gpus:
            parts = [machine.cpus * gpus / machine.gpus for machine in fitting]
        else:
            together = math.ceil(self._jobs / max(1, len(fitting))) or 1
            parts = [machine.cpus / together for machine in fitting]
        return max(1.0, float(math.floor(min(parts, default=1.0))))

    def places(self, asked: Resources) -> int:
        """Jobs at a time.

        Raises:
            UnavailableError: no machine has room for one.
        """
        settled = self.settle(asked)
        found = sum(machine.room(settled) for machine in self.machines())
        if not found:
            raise UnavailableError(
                f"no machine of the Ray cluster has what a job asks for: {_text(settled)}.",
                f"The machines have {self._machines_text()}. Ask for less with job.cpus, job.gpus "
                "or job.memory_mb.",
            )
        return min(found, self._jobs) if self._jobs else found

    def _machines_text(self) -> str:
        kinds = {
            _text(Resources(machine.cpus, machine.gpus, round(machine.memory)))
            for machine in self.machines()
        }
        return "; or ".join(sorted(kinds)) or "nothing"


def _text(resources: Resources) -> str:
    parts = [f"{resources.cpus or 0:g} cores", f"{resources.gpus or 0:g} GPUs"]
    if resources.memory:
        parts.append(f"{resources.memory / 1e6:.0f} MB")
    return ", ".join(parts)
