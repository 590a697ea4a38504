"""`gsfw tradeoff`: of a finished model with RUN, of variants that it trains with settings."""

from __future__ import annotations

from gsfw.commands.interface.arguments import FLAGS, Arguments, HelpRequested, parse

HOW = (
    "With a RUN it varies that finished model: gsfw tradeoff latest.\n"
    "With settings and no RUN it trains variants: gsfw tradeoff data=DIR target.psnr=30 "
    "budget.minutes=15.\n"
    "More: gsfw tradeoff --help."
)


def run(tokens: list[str]) -> int:
    """Measure a finished model, or train variants."""
    arguments = parse(tokens)
    if arguments.flag("help"):
        raise HelpRequested(_help())
    if names_a_run(arguments):
        from gsfw.commands.tradeoff_model import run as vary

        return vary(tokens)
    if not arguments.values.keys() - {*FLAGS}:
        from gsfw.core.errors import ConfigError

        raise ConfigError("gsfw tradeoff: neither a RUN nor settings are given.", HOW)
    from gsfw.commands.tradeoff_training import run as train

    return train(arguments)


def names_a_run(arguments: Arguments) -> bool:
    """Whether a finished model is meant: settings have keys, and only RUN stands alone."""
    return bool(arguments.words) or "run" in arguments.values


def _help() -> str:
    """Both forms, one after the other."""
    from gsfw.commands.interface.help import options_help
    from gsfw.commands.tradeoff_model import ModelOptions
    from gsfw.commands.tradeoff_training import TrainingOptions

    trains = options_help("tradeoff", TrainingOptions)
    more = "Every other key is a setting of the runs: gsfw train method=3dgs --help."
    return "\n\n".join([options_help("tradeoff", ModelOptions), trains, more])
