"""Recommendation: the command that meets what a user asks for."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from gsfw.core.metrics import PSNR_MAX
from gsfw.studies.tradeoff.front import SAME_PSNR
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS

USUAL_LOSS = 0.1
"""Decibels that may be lost where nothing is asked for."""
USUAL_LIKENESS = 40.0
"""The same where there are no photos: PSNR against renders of the model as it is, at which the two
can hardly be told apart."""


@dataclass(frozen=True)
class Wish:
    """What is asked for; ``None`` for what does not matter."""

    psnr: float | None = None
    """At least, in dB."""
    megabytes: float | None = None
    """Of the file, at most."""
    ms: float | None = None
    """To draw a view, at most."""

    def __str__(self) -> str:
        """For people."""
        asked = [
            f"at least {self.psnr:.2f} dB" if self.psnr is not None else "",
            f"at most {self.megabytes:g} MB" if self.megabytes is not None else "",
            f"at most {self.ms:g} ms" if self.ms is not None else "",
        ]
        return " and ".join(text for text in asked if text)

    def is_met(self, psnr: float | None, ms: float | None, megabytes: float | None) -> bool:
        """Whether a variant is good, small and fast enough; what is not known is not.

        Args:
            psnr: of the variant, in dB.
            ms: to draw a view, with its spread.
            megabytes: that count for it.
        """
        return (
            (self.psnr is None or (psnr or 0.0) >= self.psnr)
            and (self.megabytes is None or (megabytes is not None and megabytes <= self.megabytes))
            and (self.ms is None or (ms is not None and ms <= self.ms))
        )


@dataclass(frozen=True)
class Recommendation:
    """One sentence, and the command in it."""

    text: str
    command: str = ""
    """That can be pasted; empty where there is none."""


def recommend(
    records: Sequence[Record], wish: Wish, run: str, more: Sequence[str] = ()
) -> Recommendation:
    """The best variant that a verb makes of those that meet a wish.

    The smallest file where accuracy is asked for, or nothing is; else the most accurate one, and of
    those that are equal to 0.01 dB the smallest.

    Args:
        records: of the variants.
        wish: what is asked for.
        run: as verbs have it.
        more: further words of every command, such as where the data set is.
    """
    drawn = [record for record in records if record.psnr is not None]
    first = next(record for record in drawn if record.axis == AS_IS)
    asked = str(wish)
    if not asked and first.psnr == PSNR_MAX:
        wish = Wish(psnr=USUAL_LIKENESS)
        asked = f"at least {USUAL_LIKENESS:g} dB against the model as it is"
    elif not asked:
        wish = Wish(psnr=(first.psnr or 0.0) - USUAL_LOSS)
        asked = f"a loss of at most {USUAL_LOSS} dB"
    meeting = [r for r in drawn if wish.is_met(r.psnr, _ms(r, first), _megabytes(r))]
    doable = [record for record in meeting if record.command]
    if doable:
        chosen = min(doable, key=lambda record: _order(record, wish))
        words = ["gsfw", chosen.command[0], run, *chosen.command[1:], *more]
        command = shlex.join(words)
        return Recommendation(f"For {asked}: {command} ({_figures(chosen, first)}).", command)
    if meeting:
        best = min(meeting, key=lambda record: _order(record, wish))
        return Recommendation(
            f"{asked}: {best.axis} {best.name} has it ({_figures(best, first)}), but no verb "
            "makes it yet."
        )
    return Recommendation(f"{asked}: no variant has it.{_nearest(drawn, wish, first)}")


def _order(record: Record, wish: Wish) -> tuple[float, ...]:
    size = _megabytes(record)
    size = float("inf") if size is None else size
    psnr = record.psnr or 0.0
    if wish.psnr is not None:
        return size, -psnr
    return -float(round(psnr / SAME_PSNR)), size


def _megabytes(record: Record) -> float | None:
    """Of the file that a verb writes; of its parameters where no verb does; a render has none."""
    if record.command:
        return None if record.file_bytes is None else record.file_bytes / 1e6
    return record.parameter_bytes / 1e6


def _ms(record: Record, first: Record) -> float | None:
    """Median and spread together, so that what meets a budget does so on most days."""
    timed = first if record.draws_alike else record
    return None if timed.ms is None else timed.ms + (timed.ms_spread or 0.0)


def _figures(record: Record, first: Record) -> str:
    """What a variant has, in few words."""
    timed = first if record.draws_alike else record
    size = _megabytes(record)
    parts = [f"{record.psnr:.2f} dB"]
    parts += [] if size is None else [f"{size:.2f} MB"]
    parts += [] if timed.ms is None else [f"{timed.ms:.1f} ms"]
    return ", ".join(parts)


def _nearest(drawn: Sequence[Record], wish: Wish, first: Record) -> str:
    """The best figure of each kind that was asked for, one by one."""
    said = []
    if wish.psnr is not None:
        said.append(f"{max(record.psnr or 0.0 for record in drawn):.2f} dB at most")
    sizes = [size for record in drawn if (size := _megabytes(record)) is not None]
    if wish.megabytes is not None and sizes:
        said.append(f"{min(sizes):.2f} MB at least")
    times = [ms for record in drawn if (ms := _ms(record, first)) is not None]
    if wish.ms is not None and times:
        said.append(f"{min(times):.1f} ms at least, spread included")
    return f" There is {', '.join(said)}." if said else ""
