"""Launch: starts the processes of a training on this machine, or joins those of torchrun.

``gsfw train processes=4`` starts four copies of its own command line by torch's launcher, as
``torchrun --nproc-per-node=4 -m gsfw train`` does. Each copy finds its number in the environment.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
import torch.distributed as dist
from torch.distributed import (  # type: ignore[attr-defined]
    FileStore,
    HashStore,
    PrefixStore,
    Store,
    TCPStore,
)

from gsfw.core.cores import CHOSEN, chosen_threads, cores
from gsfw.core.team import Team
from gsfw.parallel.data_parallel import DataParallel
from gsfw.parallel.environment import patience, rank, world
from gsfw.parallel.group import losses_named
from gsfw.parallel.sharded.team import GaussianParallel
from gsfw.parallel.shared_memory import group_on

if TYPE_CHECKING:
    from torch.distributed.elastic.multiprocessing.errors import ProcessFailure

LOCAL = "127.0.0.1"
MODULE = ("-m", "gsfw")
STORE = "GSFW_STORE"
"""Environment variable: the file by which processes of ``run_workers`` find one another. torch's
own way is a server that listens on every interface and lets in whoever comes: who reaches it can
send processes to addresses of theirs, and processes trust what they receive from one another."""
FAILED = 1
STUBBORN = 25
"""Seconds after the first failure in which a process ends by itself; torch kills it after 30."""


@contextmanager
def connected(device: torch.device, shards: int = 0) -> Iterator[Team]:
    """The team of this process and the others of its launcher; of this one without a launcher.

    Args:
        device: of the training.
        shards: of rows and images; 0 if every process has all rows.

    Raises:
        LostProcessError: the others cannot be reached.
    """
    size = world()
    if size is None:
        store: Store | None = HashStore()
        os.environ.update(_on_loopback())
    else:
        torch.set_num_threads(_threads())
        store = _of_this_start(size)
    options: dict[str, Any] = {"init_method": "env://"}
    if store is not None:
        options = {"store": store, "rank": rank(), "world_size": size or 1}
    if device.type == "cuda" and device.index is None:
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
    backend = "gloo" if device.type == "cpu" else "cpu:gloo,cuda:nccl"
    limit = timedelta(minutes=patience())
    with losses_named():
        dist.init_process_group(backend, timeout=limit, **options)
    try:
        with losses_named():
            # No variable refers to a channel, which ends with its last reference (``Group.spare``).
            has_spare = shards > 0 and device.type == "cpu"
            group = group_on(device, dist.new_group(timeout=limit) if has_spare else None)
        yield GaussianParallel(group, shards) if shards else DataParallel(group)
    finally:
        dist.destroy_process_group()


def _of_this_start(size: int) -> Store | None:
    """The store of the launcher, with keys of this start of the processes; ``None`` without one.

    torchrun keeps one store for all starts: under their usual keys, restarted processes may find
    the addresses of those that have ended, and wait for them.
    """
    store = _kept_by_launcher()
    if store is None:
        return None
    return PrefixStore(f"gsfw/start_{os.environ.get('TORCHELASTIC_RESTART_COUNT')}_{size}", store)


def tell_launcher(folder: Path) -> None:
    """Tell the launcher which run its processes have begun, for processes that it starts later."""
    store = _kept_by_launcher()
    if store is not None:
        store.set(_key(), str(folder.resolve()))


def run_of_launcher() -> Path | None:
    """The run that earlier processes of this launcher have begun; ``None`` if there is none.

    torchrun starts all processes again after one has ended (``--max-restarts``), or when a machine
    has joined.
    """
    store = _kept_by_launcher()
    if store is None or not store.check([_key()]):
        return None
    return Path(store.get(_key()).decode())


def _kept_by_launcher() -> Store | None:
    """The store of a launcher, which outlives its processes; ``None`` under unknown launchers."""
    if os.environ.get(STORE):
        return FileStore(os.environ[STORE], -1)  # For any number of processes; it stays.
    if os.environ.get("TORCHELASTIC_USE_AGENT_STORE") != "True":
        return None
    port = int(os.environ["MASTER_PORT"])
    with losses_named():
        return TCPStore(os.environ["MASTER_ADDR"], port, is_master=False, wait_for_workers=False)


def _key() -> str:
    return f"gsfw/run/{os.environ.get('TORCHELASTIC_RUN_ID', '')}"


def _threads() -> int:
    """Threads of this process: an equal part of the cores, unless the user has set a number.

    torchrun sets one thread where the user has set none.
    """
    given = chosen_threads() or 1
    on_this_machine = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    return given if given > 1 else max(cores() // on_this_machine, 1)


def run_workers(arguments: Sequence[str], processes: int) -> int:
    """Run a command line of gsfw in several processes of this machine; return the exit code.

    Ctrl-C and SIGTERM go to each of them, so that they stop after the same step.
    """
    from torch.distributed.elastic.multiprocessing import (
        DefaultLogsSpecs,
        SignalException,
        start_processes,
    )

    # Failures are reported here, in the words of gsfw.
    logging.getLogger("torch.distributed.elastic").setLevel(logging.CRITICAL)
    with tempfile.TemporaryDirectory(prefix="gsfw-processes-") as folder:  # This user's alone.
        store = str(Path(folder, "store"))
        workers = start_processes(
            "gsfw",
            sys.executable,
            args={rank: (*MODULE, *arguments) for rank in range(processes)},
            envs={rank: _environment(rank, processes, store) for rank in range(processes)},
            logs_specs=DefaultLogsSpecs(),
        )
        pids = workers.pids()
        while True:
            try:
                result = workers.wait(period=0.1)
                break
            except SignalException as received:
                for pid in pids.values():
                    _send(pid, received.sigval)
    if result is None or not result.is_failed():
        return 0
    return _report(result.failures)


def _send(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:  # It has ended meanwhile.
        return


def _environment(rank: int, processes: int, store: str) -> dict[str, str]:
    """The variables by which a process finds the others: those of torchrun, and the store."""
    found = {
        "RANK": str(rank),
        "LOCAL_RANK": str(rank),
        "WORLD_SIZE": str(processes),
        "LOCAL_WORLD_SIZE": str(processes),
        "MASTER_ADDR": LOCAL,
        STORE: store,
        CHOSEN: str(chosen_threads() or max(cores() // processes, 1)),
    }
    return found | _on_loopback()


def _on_loopback() -> dict[str, str]:
    """Variables by which gloo uses no address of this machine that others may reach, or nobody."""
    return {"GLOO_SOCKET_IFNAME": "lo"} if sys.platform == "linux" else {}


def _report(failures: Mapping[int, ProcessFailure]) -> int:
    """Name the processes that were ended by a signal; return the exit code of the whole.

    torch ends the other processes by SIGTERM when one has failed, and later by SIGKILL.
    """
    first = min(failure.timestamp for failure in failures.values())
    for number, failure in sorted(failures.items()):
        if failure.exitcode >= 0 or -failure.exitcode == signal.SIGTERM:
            continue
        name = signal.Signals(-failure.exitcode).name
        # All that end while torch waits for one of them have the time of the end of the wait.
        if name == "SIGKILL" and failure.timestamp - first >= STUBBORN:
            said = (
                f"process {number} had not ended 30 seconds after another one failed, and was ended"
            )
        elif name in ("SIGKILL", "SIGBUS"):
            said = f"process {number} was ended by {name} (memory may have run out)"
        else:
            said = f"process {number} was ended by {name}"
        # The first process, which names the remedy otherwise, cannot.
        advice = "Go on from the last checkpoint with gsfw resume RUN.\n" if number == 0 else ""
        sys.stderr.write(f"error: {said}\n{advice}")
    codes = {number: failure.exitcode for number, failure in failures.items()}
    ended = (128 + signal.SIGTERM, -signal.SIGTERM)
    if codes.get(0) in ended and not all(code in ended for code in codes.values()):
        return FAILED
    return max(codes.get(0, 0), 0) or FAILED
