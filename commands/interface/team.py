"""Team: the processes of a command that trains, started by it or by torchrun."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from gsfw.commands.interface.arguments import Arguments
from gsfw.commands.interface.console import Console, ProgramConsole
from gsfw.core.errors import ConfigError, LostProcessError, UserError
from gsfw.parallel.environment import check_processes, is_follower, leave, rank, world

if TYPE_CHECKING:
    from gsfw.core.team import Team

Built = TypeVar("Built")


def with_processes(arguments: Arguments) -> Arguments:
    """The arguments, with ``processes`` as the launcher says, if there is one.

    Raises:
        ConfigError: another number is given.
    """
    started = world()
    if started is None:
        return arguments
    given = arguments.values.get("processes", str(started))
    check_processes(int(given) if given.isdigit() else 0)
    return replace(arguments, pairs=(("processes", str(started)), *arguments.pairs))


def console_of(arguments: Arguments) -> Console:
    """The console of a command; a quiet one in all processes of a launcher but the first."""
    return ProgramConsole(is_quiet=True) if is_follower() else Console(arguments.flag("json"))


def starts_workers(processes: int) -> bool:
    """True if this command has to start the processes of its training."""
    return processes > 1 and world() is None


def check_started(processes: int) -> None:
    """Check that the processes of a training that was called from Python run already.

    Raises:
        ConfigError: they do not; the command line starts them.
    """
    if starts_workers(processes):
        raise ConfigError(
            f"processes={processes}: a Python program is one process.",
            "Train with gsfw train or gsfw resume, or start the program with torchrun.",
        )


def run_workers(tokens: Sequence[str], processes: int) -> int:
    """Run a command in several processes; return the exit code."""
    from gsfw.parallel.launch import run_workers

    return run_workers(tokens, processes)


@contextmanager
def joined(processes: int, shards: int, device: str) -> Iterator[Team]:
    """The team of this process, connected to the others of its launcher.

    Args:
        processes: their number; 0 for a process that trains alone, unless there are shards.
        shards: of rows and images; 0 if the views are divided.
        device: of the training.

    Raises:
        TrainingError: the others cannot be reached.
    """
    from gsfw.core.team import ALONE

    if processes == 0 and shards == 0:
        yield ALONE
        return
    from gsfw.parallel.launch import connected
    from gsfw.plugins.devices import find_device

    with connected(find_device(device), shards) as team, _own_errors_told():
        yield team


@contextmanager
def _own_errors_told() -> Iterator[None]:
    """Print the errors of a follower that no other process has, such as a damaged photo.

    Raises:
        SystemExit: in place of such an error, or of the loss of another process.
    """
    try:
        yield
    except UserError as error:
        if not is_follower() or isinstance(error, ConfigError):  # All find wrong settings.
            raise
        if isinstance(error, LostProcessError):
            leave(error.exit_code)
        sys.stderr.write(f"error: process {rank()}: {error.message}\n{error.advice}\n")
        raise SystemExit(error.exit_code) from error


def tell_launcher(run: Path) -> None:
    """Tell torchrun, if it is there, which run has begun, for ``run_left``."""
    if world() is not None:
        from gsfw.parallel.launch import tell_launcher

        tell_launcher(run)


def run_left(team: Team) -> Path | None:
    """The run to go on with, which earlier processes of the same launcher have begun.

    The first process looks for it. What was left before the first checkpoint is removed.

    Returns:
        Its folder, the same in every process; ``None`` for a new run.
    """
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.parallel.launch import run_of_launcher

    found = run_of_launcher() if team.leads and world() is not None else None
    if found is not None:
        folder = RunFolder(found)
        if not folder.config.is_file() or folder.latest_checkpoint() is None:
            shutil.rmtree(found, ignore_errors=True)
            found = None
    return team.gathered(found)[0]


def together(team: Team, build: Callable[[], Built]) -> Built:
    """Build something in every process; if one fails, all end, with one message.

    Raises:
        UserError: building failed in this process, or in another one.
        SystemExit: the first process reports the error.
    """
    built, error = None, None
    try:
        built = build()
    except UserError as raised:
        error = raised
    failures = team.gathered(None if error is None else (error.message, error.advice))
    if error is not None and team.leads:
        raise error
    for number, failure in enumerate(failures):
        if failure is not None:
            if not team.leads:
                leave(UserError.exit_code)
            message, advice = failure
            raise UserError(f"process {number}: {message}", advice)
    assert built is not None
    return built
