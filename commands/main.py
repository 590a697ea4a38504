"""The command line: finds and runs the verb, and turns every error into one clear message."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from importlib import metadata
from signal import Signals

from gsfw.commands.interface.arguments import HelpRequested, parse
from gsfw.commands.interface.console import Console, LoggedWarnings
from gsfw.commands.interface.failure import INTERRUPTED, report
from gsfw.commands.interface.help import main_help
from gsfw.commands.interface.interrupt import leave_on_signal
from gsfw.commands.interface.progress import SlowStages
from gsfw.commands.interface.streams import lasting_streams
from gsfw.core.cores import limit_threads
from gsfw.core.errors import ConfigError, DataError, EndedBySignal, UserError
from gsfw.core.progress import shown_by
from gsfw.parallel.environment import is_follower
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry, did_you_mean, installed
from gsfw.plugins.specs import PROJECT

SPINS = "1000"
"""Spins of an idle torch thread before it sleeps (GOMP_SPINCOUNT). With the library's own default,
two threads on two busy cores wait for one another: rendering 3,000 splats forward and backward
took 2.8 s instead of 80 ms; on idle cores the value has no measurable cost."""

HELP = ("--help", "-h", "help")
"""First words that ask for help, on the verb that follows or on all."""
SHOW_BROKEN = ("plugins", "doctor")
"""Verbs that report broken plugins themselves."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; return the exit code.

    0: done. 1: failed. 2: an error that the user can correct. 130: interrupted.

    Raises:
        SystemExit: the program was ended by SIGTERM (143) or SIGHUP (129).
    """
    os.environ.setdefault("GOMP_SPINCOUNT", SPINS)  # Read when torch is loaded.
    limit_threads()
    # On damaged EXIF, and on large images; important cases have messages of their own.
    warnings.filterwarnings("ignore", module=r"PIL\b")
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    console = Console(_flag(tokens, "json"))
    with lasting_streams():
        return _reported(tokens, console)


def _reported(tokens: list[str], console: Console) -> int:
    """Run one verb, and report how it ends where it does not end well; return the exit code."""
    try:
        with leave_on_signal(), LoggedWarnings(console).shown():
            code = _answer(tokens, console)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        if not is_follower():
            sys.stderr.write("\ninterrupted\n")
        return INTERRUPTED
    except EndedBySignal as ended:
        if not is_follower():
            sys.stderr.write(f"\nended by {Signals(ended.code - 128).name}\n")
        raise
    except Exception as error:
        return report(error, console, _flag(tokens, "debug"))


def _flag(tokens: list[str], name: str) -> bool:
    """True if a flag is on, even if the rest of the line is invalid."""
    try:
        return parse(tokens).flag(name)
    except UserError:
        return f"--{name}" in tokens


def _first_word(tokens: list[str]) -> str:
    """The first word that is no setting; empty if there is none, or the line is invalid."""
    try:
        return next(iter(parse(tokens).words), "")
    except UserError:
        return ""


def _answer(tokens: list[str], console: Console) -> int:
    """Run one verb, or print the help that it was asked for; return the exit code."""
    try:
        return _run(tokens, console)
    except HelpRequested as wanted:
        console.say(str(wanted))
        console.result({"help": str(wanted)})
        return 0


def _run(tokens: list[str], console: Console) -> int:
    if not tokens or tokens[0] in HELP:
        topic = _first_word(tokens[1:])
        if not topic or topic in HELP:
            raise HelpRequested(main_help(installed()))
        rest = [token for token in tokens[1:] if token != topic]
        tokens = [topic, *rest, "--help"]  # gsfw help train.
    if tokens[0] in ("--version", "version"):
        console.say(f"{PROJECT} {metadata.version(PROJECT)}")
        console.result({PROJECT: metadata.version(PROJECT)})
        return 0
    _check_folder()
    verb = _find_verb(tokens[0], installed())
    if tokens[0] not in SHOW_BROKEN:
        installed().tell_broken(console.warn)
    # Help waits for torch, as strategies and rasterizers import it beside their settings.
    is_silent = is_follower() or _flag(tokens, "help")
    with nullcontext() if is_silent else shown_by(SlowStages().stage):
        code = verb(tokens[1:])
    if tokens[0] not in SHOW_BROKEN:
        installed().tell_broken(console.warn)  # Some fail only when they are loaded.
    return code


def _check_folder() -> None:
    """Check that the current folder exists: without one, torch ends the process as it is loaded.

    Raises:
        DataError: it was removed or renamed, or its disk is gone.
    """
    try:
        os.getcwd()
    except OSError as error:
        raise DataError(
            f"the current folder cannot be found any more ({error.strerror}).",
            "Change to a folder that exists, such as: cd ~",
        ) from error


def _find_verb(name: str, registry: Registry) -> Callable[[list[str]], int]:
    verbs = registry.slot("command")
    if name not in verbs:
        raise ConfigError(
            f"gsfw has no verb {name!r}.{did_you_mean(name, verbs)}",
            f"Verbs: {', '.join(verbs)}. See gsfw --help.",
        )
    verb: Callable[[list[str]], int] = load("command", verbs[name])
    return verb
