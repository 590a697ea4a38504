"""Splat instant: the splats of a file at a time, and formats that hold no single time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, Holds, SplatFile
from gsfw.core.motion.evaluation import splats_at
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.registry import Registry


def check_time(time: float) -> None:
    """Check a time of a moving model or file.

    Raises:
        ConfigError: it is no number in [0, 1].
    """
    if not 0 <= time <= 1:
        raise ConfigError(f"time={time:g}: expected a time in [0, 1].")


def check_export_time(time: float, form: str, exporter: Exporter) -> None:
    """Check a time for the splats of a moving model or file that are to be written.

    Args:
        time: as given; 0 for none.
        form: name of the format that is to be written.
        exporter: of the format.

    Raises:
        ConfigError: it is out of range, or the format holds all times.
    """
    check_time(time)
    if time and exporter.holds not in (Holds.SPLATS, Holds.DEPTHS):
        raise ConfigError(
            f"time={time:g}: format {form} holds {exporter.holds.value}, at all times.",
            "Leave time out, or choose a format of splats at one time, such as ply.",
        )


def read_at(path: Path, time: float, registry: Registry) -> SplatFile:
    """Read the splats of a file at a time; splats at rest are the same at all times.

    Args:
        path: a file, or a folder, of splats.
        time: in [0, 1], from the first to the last time of the file.
        registry: the installed parts.

    Raises:
        DataError: it is missing, damaged, or of no format that can be read.
    """
    importer = find_importer(path, registry)
    if not time:
        return importer.read(path)
    moving = importer.read_motion(path)
    if moving.is_still:
        return moving.content
    return replace(moving.content, splats=replace(splats_at(moving, time), rows=None))
