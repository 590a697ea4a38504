"""`gsfw tradeoff`: quality, size and speed of a finished model, or of variants that it trains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.commands.interface.arguments import FLAGS, Arguments, HelpRequested, parse

if TYPE_CHECKING:
    from gsfw.studies.tradeoff.recommendation import Wish

HOW = (
    "With a RUN it varies that finished model: gsfw tradeoff latest.\n"
    "With settings and no RUN it trains variants: gsfw tradeoff data=DIR target.psnr=30 "
    "budget.minutes=15.\n"
    "More: gsfw tradeoff --help."
)


@dataclass
class Target:
    """Bounds that must be reached."""

    psnr: float | None = None
    """Minimum PSNR of the recommended variant on held-out views, in dB."""


@dataclass
class Budget:
    """Bounds that must not be exceeded."""

    mb: float | None = None
    """Largest file of the recommended variant, in megabytes."""
    ms: float | None = None
    """Longest time to render a view, in milliseconds, spread included."""


def run(tokens: list[str]) -> int:
    """Measure a finished model, or train variants."""
    arguments = parse(tokens)
    if arguments.flag("help"):
        raise _help()
    if names_a_run(arguments):
        from gsfw.commands.tradeoff.model import run as vary

        return vary(tokens)
    if not arguments.values.keys() - {*FLAGS}:
        from gsfw.core.errors import ConfigError

        raise ConfigError("gsfw tradeoff: neither a RUN nor settings are given.", HOW)
    from gsfw.commands.tradeoff.training import run as train

    return train(arguments)


def names_a_run(arguments: Arguments) -> bool:
    """True if the arguments name a finished model, by a bare word or by ``run``."""
    return bool(arguments.words) or "run" in arguments.values


def wish_of(target: Target, budget: Budget) -> Wish:
    """The bounds of a recommendation."""
    from gsfw.studies.tradeoff.recommendation import Wish

    return Wish(target.psnr, budget.mb, budget.ms)


def check_budget(budget: Budget) -> None:
    """Refuse bounds that are not positive, before anything is loaded.

    Raises:
        ConfigError: names the key, the value, and the expected range.
    """
    from gsfw.core.errors import ConfigError

    for name, limit in vars(budget).items():
        if limit is not None and not limit > 0:
            raise ConfigError(f"budget.{name}={limit:g}: expected a number above 0.")


def _help() -> HelpRequested:
    """The help of both forms."""
    from gsfw.commands.interface.help import options_help
    from gsfw.commands.interface.page import paragraphs
    from gsfw.commands.tradeoff.model import ModelOptions
    from gsfw.commands.tradeoff.training import TrainingOptions

    trains = options_help("tradeoff", TrainingOptions)
    more = paragraphs("Every other key is a setting of the runs: gsfw train method=3dgs --help.")
    text = "\n\n".join([options_help("tradeoff", ModelOptions), trains, more])
    return HelpRequested(text, (ModelOptions, TrainingOptions))
