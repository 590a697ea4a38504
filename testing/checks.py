"""Checks: the promises of each kind of part, and functions that check a part by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType

from gsfw.testing.everywhere import EVERYWHERE
from gsfw.testing.promise import Outcome, Promise, Verdict
from gsfw.testing.subject import Subject, check_slot, find_subject, parts_of

KINDS = {
    "method": "methods",
    "strategy": "strategies",
    "rasterizer": "rasterizers",
    "datamanager": "datamanagers",
    "sampler": "samplers",
    "metric": "metrics",
    "callback": "callbacks",
    "exporter": "exporters",
    "importer": "importers",
    "command": "commands",
    "operators": "operators",
}
"""Module of this folder with the promises of each kind, ``PROMISES``."""


class ConformanceError(AssertionError):
    """A part breaks promises; the message names each with the observation and the remedy."""

    def __init__(self, broken: Sequence[Outcome]) -> None:
        super().__init__("\n\n".join(str(outcome) for outcome in broken))
        self.broken = tuple(broken)
        """Outcomes of the broken promises."""


def promises(slot: str) -> tuple[Promise, ...]:
    """All promises of a kind of part: those of every kind, then its own.

    Raises:
        ConfigError: there is no such kind.
    """
    check_slot(slot)
    own: tuple[Promise, ...] = import_module(f"{__package__}.{KINDS[slot]}").PROMISES
    return (*EVERYWHERE, *own)


def outcomes(subject: Subject, only: Sequence[str] = ()) -> Iterator[Outcome]:
    """Check the promises of a part; yields each outcome at once.

    If the part cannot be loaded, only the promises about its registration are checked.

    Args:
        subject: the part.
        only: names of promises; empty for all.
    """
    for promise in promises(subject.slot):
        if only and promise.name not in only:
            continue
        outcome = promise.check(subject)
        yield outcome
        if promise.is_required and outcome.verdict is Verdict.BROKEN:
            return


def check(
    slot: str,
    name: str,
    *,
    plugin: ModuleType | object | str | None = None,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> list[Outcome]:
    """Check every promise of a part.

    Args:
        slot: kind of the part: method, strategy, rasterizer, datamanager, sampler, metric,
            callback, exporter, importer, command or operators.
        name: registered name.
        plugin: a module with hooks that is not installed, its import name, or an object with
            hooks; ``None`` for installed parts.
        data: data set for the checks; ``None`` for one that the kit makes.
        settings: settings of every run of the kit, as on the command line.

    Returns:
        The outcomes: all promises are kept, or do not concern the part.

    Raises:
        ConformanceError: a promise is broken.
        ConfigError: there is no such part.
    """
    return _kept([find_subject(slot, name, plugin=plugin, data=data, settings=settings)])


def check_plugin(
    name: str,
    *,
    plugin: ModuleType | object | str | None = None,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> list[Outcome]:
    """Check every promise of every part of a plugin.

    Args:
        name: an installed distribution, or the import name of a module with hooks.
        plugin: as for ``check``.
        data: as for ``check``.
        settings: as for ``check``.

    Raises:
        ConformanceError: a promise is broken.
        ConfigError: the plugin registers nothing.
    """
    return _kept(parts_of(name, plugin=plugin, data=data, settings=settings))


def _kept(subjects: Sequence[Subject]) -> list[Outcome]:
    found = [outcome for subject in subjects for outcome in outcomes(subject)]
    broken = [outcome for outcome in found if outcome.verdict is Verdict.BROKEN]
    if broken:
        raise ConformanceError(broken)
    return found


check_method = partial(check, "method")
check_strategy = partial(check, "strategy")
check_rasterizer = partial(check, "rasterizer")
check_datamanager = partial(check, "datamanager")
check_sampler = partial(check, "sampler")
check_metric = partial(check, "metric")
check_callback = partial(check, "callback")
check_exporter = partial(check, "exporter")
check_importer = partial(check, "importer")
check_command = partial(check, "command")
check_operators = partial(check, "operators")
