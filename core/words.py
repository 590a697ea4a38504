"""Words: times, bytes, counts and arguments of commands, the same in every message and page."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Iterable, Mapping, Sequence


def duration(seconds: int | float) -> str:
    """A time in the two largest units that it needs: "17 s", "8 min 20 s", "3 h 5 min"."""
    hours, minutes, rest = _parts(seconds)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def rough_duration(seconds: int | float) -> str:
    """An estimated time, in one unit: "40 s", "12 min", "3.5 h"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def clock(seconds: int | float) -> str:
    """A time as minutes and seconds, or with hours: "0:17", "1:02:05"."""
    hours, minutes, rest = _parts(seconds)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def size(count: int | float) -> str:
    """A number of bytes: "812 kB", "2.9 MB", "1.3 GB"."""
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= 0.9995 * unit:
            amount = count / unit
            is_whole = amount >= 100 or unit == 1e3
            return f"{amount:.0f} {name}" if is_whole else f"{amount:.1f} {name}"
    return f"{count:.0f} bytes"


def rough_size(count: int | float) -> str:
    """An estimated number of bytes: "74 MB", "3.5 GB", "25 GB"."""
    unit, name = (1e9, "GB") if count >= 0.9995e9 else (1e6, "MB")
    amount = count / unit
    return f"{amount:.1f} {name}" if unit == 1e9 and amount < 9.95 else f"{amount:.0f} {name}"


def counted(count: int, noun: str, plural: str = "") -> str:
    """A number of things: "1 view", "1,200 views"; ``plural`` for nouns that take no "s"."""
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


def brief(number: int | float, digits: int = 4) -> str:
    """A number in few characters, rounded to some digits: "950", "12.3k", "4.56M", "2.5G"."""
    number = float(f"{number:.{digits}g}")
    for unit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(number) >= unit:
            return f"{number / unit:.{digits}g}{letter}"
    return f"{number:.{digits}g}"


def listed(names: Sequence[str], most: int = 5) -> str:
    """The first ``most`` names, and how many more there are: "a.png, b.png and 3 more"."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def capitalized(text: str) -> str:
    """A clause as the beginning of a sentence; unlike ``str.capitalize`` it keeps other letters."""
    return text[:1].upper() + text[1:]


def uncapitalized(text: str) -> str:
    """A sentence as the continuation of another one."""
    return text[:1].lower() + text[1:]


def metric_name(name: str) -> str:
    """A metric as people read it: "moving_psnr" is "moving PSNR"."""
    words = name.replace("_", " ").replace("color corrected", "colour-corrected")
    return words.replace("psnr", "PSNR").replace("ssim", "SSIM").replace("lpips", "LPIPS")


def shown_metrics(names: Iterable[str], protocol: Mapping[str, object]) -> list[str]:
    """The metrics worth a row: colour-corrected ones only of runs that learnt exposures.

    Args:
        names: names of metrics.
        protocol: the measurement protocol of the figures; empty if unknown.
    """
    return [name for name in names if "exposure" in protocol or "color_corrected" not in name]


def _parts(seconds: int | float) -> tuple[int, int, int]:
    """Whole hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return hours, minutes, rest


def suggestion(given: str, known: Sequence[str]) -> str:
    """Suggest the known name most like ``given``, in a sentence with a leading space.

    Empty if none is near.
    """
    near = difflib.get_close_matches(given, known, 1)
    return f" Did you mean {near[0]!r}?" if near else ""


def shell_argument(value: object) -> str:
    """A path or another value, as it is typed into a shell: with quotes if it needs them."""
    return shlex.quote(str(value))
