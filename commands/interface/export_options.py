"""Export options: their fit to each other and to the format of the file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.errors import ConfigError
from gsfw.core.files.reading import names_folder

if TYPE_CHECKING:
    from gsfw.commands.export import ExportOptions
    from gsfw.core.exchange import Exporter
    from gsfw.plugins.registry import Registry

PLY = "ply"
"""Format of an export that names none."""


def check_options(options: ExportOptions) -> None:
    """Check the options before anything is loaded.

    Raises:
        ConfigError: two options contradict each other.
    """
    if options.times and options.time:
        raise ConfigError(
            f"time={options.time:g} and times={options.times} are both given.",
            "Give time for one file, or times for a sequence.",
        )


def format_of_file(options: ExportOptions, registry: Registry) -> str:
    """The format that is given, or else the first one that writes files with the suffix of out.

    Raises:
        ConfigError: no exporter writes such files.
    """
    from gsfw.plugins.exporters import format_for, format_of

    out = Path(options.out)
    is_file = bool(out.suffix) and not names_folder(options.out)
    form = format_of(out, registry) if is_file else None
    if options.times and form is not None and not options.format:
        raise ConfigError(
            f"out={out}: times={options.times} writes a folder of files.",
            f"Give a folder, and the format of its files: out={out.stem} format={form}",
        )
    if options.format or options.times or not is_file:
        return options.format or PLY
    return format_for(out, registry, f"out={out}")


def check_format(options: ExportOptions, exporter: Exporter) -> None:
    """Check that the options fit the content of the format.

    Raises:
        ConfigError: an option does not fit.
    """
    from gsfw.core.exchange import Holds

    holds = exporter.holds
    is_cut = options.keep < 1 or options.sh_degree is not None
    if is_cut and (options.times or holds is not Holds.SPLATS):
        what = f"times={options.times}" if options.times else f"format={options.format}"
        raise ConfigError(
            f"{what}: keep and sh_degree cut down one set of splats.",
            "Give them with format=ply, and without times.",
        )
    if options.budget and (options.keep < 1 or holds not in (Holds.SPLATS, Holds.MOTION)):
        what = f"keep={options.keep:g}" if options.keep < 1 else f"format={options.format}"
        raise ConfigError(
            f"budget={options.budget}: {what} cannot be given with it.",
            "Give one of budget and keep, and a format of splats, such as ply, web or lod.",
        )
    if holds in (Holds.MODEL, Holds.MOTION) and (options.times or options.time):
        what = "the model" if holds is Holds.MODEL else "splats"
        raise ConfigError(
            f"format={options.format} holds {what} at all times: leave out time and times.",
            "To write one time: format=ply time=0.5",
        )
    if options.times and (holds is Holds.DEPTHS or exporter.is_folder):
        raise ConfigError(
            f"format={options.format} is written at one time: leave out times.",
            "Choose the time: time=0.5",
        )


def is_in_splats(options: ExportOptions, exporter: Exporter) -> bool:
    """True if splats.ply of a still run has all that is written, to another file.

    The parts that training views need are not in it.
    """
    from gsfw.core.exchange import Holds

    is_other = bool(options.out) or options.format != PLY
    return is_other and exporter.holds is Holds.SPLATS and options.keep == 1 and not options.budget
