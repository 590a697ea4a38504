"""Options of formats: ``format=spz format.version=4``, for every verb that writes splat files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from gsfw.commands.interface.arguments import HelpRequested, Options, parse, read_options

VerbOptions = TypeVar("VerbOptions", bound=Options)


def read_with_format(
    verb: str, kind: type[VerbOptions], tokens: Sequence[str]
) -> tuple[VerbOptions, dict[str, str]]:
    """The options of a verb, and the texts of the options of the format by name.

    Raises:
        HelpRequested: ``--help`` was given; with ``format=NAME``, it explains that format, too.
        ConfigError: as of ``read_options``.
    """
    from gsfw.plugins.exporters import PREFIX

    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if not key.startswith(PREFIX)]
    given = {
        key.removeprefix(PREFIX): text for key, text in arguments.pairs if key.startswith(PREFIX)
    }
    try:
        return read_options(verb, kind, [*own, *arguments.words]), given
    except HelpRequested as wanted:
        form = arguments.values.get("format")
        if not form:
            raise
        raise HelpRequested(f"{wanted}\n\n{format_help(form)}", wanted.options) from None


def format_help(form: str) -> str:
    """The options of a format, with types, defaults and meanings.

    Raises:
        ConfigError: there is no such format.
    """
    from gsfw.commands.interface.help import option_row
    from gsfw.commands.interface.page import option_table
    from gsfw.plugins.exporters import exporter_options
    from gsfw.plugins.loading import load
    from gsfw.plugins.registry import installed

    spec = installed().find("exporter", form)
    options = exporter_options(load("exporter", spec))
    title = f"format {form}: {spec.description}"
    if not options:
        return f"{title}\n  It has no options."
    return option_table(list(map(option_row, options)), title)
