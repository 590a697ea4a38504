"""`gsfw plugins check NAME`: checks that parts keep what gsfw expects of them."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import Options, positional, read_options

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.testing import Outcome, Subject

BROKEN = 1
"""Exit code if a promise is broken."""


@dataclass(kw_only=True)
class PluginCheckOptions(Options):
    """Check a part, or all parts of a plugin, against the promises of its kind.

    Exit codes: 0 all promises are kept; 1 some are broken; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw plugins check my-method",
        "gsfw plugins check ply slot=exporter",
        "gsfw plugins check gsfw-my-plugin data=captures/garden",
        "gsfw plugins check my_module only=learns",
    )

    name: str = positional("NAME")
    """A part, an installed package, or a module with hooks, which need not be installed."""
    slot: str = ""
    """Kind of the part: method, rasterizer, strategy, ... Empty: all parts of this name."""
    data: str = ""
    """Data set for the checks, which data managers of files need. Empty: the built-in scene."""
    settings: tuple[str, ...] = ()
    """Settings of every run of the checks, such as strategy.every=10,steps=50."""
    only: tuple[str, ...] = ()
    """Promises to check, by name; empty: all."""


def run(arguments: list[str]) -> int:
    """Check, and print a line for each promise."""
    options = read_options("plugins check", PluginCheckOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.testing import Verdict, subjects_named

    data = Path(options.data) if options.data else None
    subjects = subjects_named(options.name, options.slot, data=data, settings=options.settings)
    _check_only(options.only, subjects)
    console, found = Console(options.json), []
    with _quiet():
        for subject in subjects:
            found += _checked(console, subject, options.only)
    broken = [outcome for outcome in found if outcome.verdict is Verdict.BROKEN]
    if broken:
        console.say("\nbroken promises:")
    for outcome in broken:
        told = f"{outcome.happened} {outcome.change}".replace("\n", " ")
        console.say(f"  {outcome.subject}: {outcome.promise.name}: {told}")
    kept = sum(outcome.verdict is Verdict.KEPT for outcome in found)
    other = len(found) - kept - len(broken)
    console.say(f"{kept} kept, {len(broken)} broken, {other} not applicable")
    console.result({"kind": "plugins check", "promises": [_document(item) for item in found]})
    return BROKEN if broken else 0


def _check_only(only: Sequence[str], subjects: Sequence[Subject]) -> None:
    """Check the names of promises.

    Raises:
        ConfigError: no part has a promise of a name; suggests the nearest one.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import did_you_mean
    from gsfw.testing import promises

    known = {promise.name: None for subject in subjects for promise in promises(subject.slot)}
    for name in only:
        if name not in known:
            raise ConfigError(
                f"only={name}: there is no such promise.{did_you_mean(name, known)}",
                f"Promises: {', '.join(known)}.",
            )


def _checked(console: Console, subject: Subject, only: Sequence[str]) -> list[Outcome]:
    """Check the promises of one part, with a line for each."""
    from gsfw.testing import Verdict, outcomes

    console.say(f"{subject}")
    found = []
    for outcome in outcomes(subject, only):
        found.append(outcome)
        why = f": {outcome.happened}" if outcome.verdict is Verdict.NOT_APPLICABLE else ""
        line = f"{outcome.verdict.value:14}  {outcome.promise.name} ({outcome.seconds:.1f} s){why}"
        console.say(f"  {line.splitlines()[0]}")
    return found


@contextmanager
def _quiet() -> Iterator[None]:
    """Hold back the warnings of the small runs: what is wrong in them is the checks' to say."""
    logger = logging.getLogger("gsfw")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


def _document(outcome: Outcome) -> dict[str, Any]:
    """Plain data for ``json=true``."""
    return {
        "part": outcome.subject,
        "promise": outcome.promise.name,
        "sentence": outcome.promise.sentence,
        "verdict": outcome.verdict.value,
        "happened": outcome.happened,
        "change": outcome.change,
        "seconds": round(outcome.seconds, 3),
    }
