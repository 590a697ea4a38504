"""Report: the variants of a finished model as plain data, as tables, and as offers."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from statistics import mean, stdev
from typing import Any

from gsfw.core.metrics import PSNR_MAX
from gsfw.studies.table import Table
from gsfw.studies.tradeoff.front import SAME_PSNR, size_front, time_front
from gsfw.studies.tradeoff.recommendation import Offer, Wish
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS, AXES

USUAL_LOSS = 0.1
"""Decibels that may be lost where nothing is asked for."""
USUAL_LIKENESS = 40.0
"""Least PSNR against renders of the unchanged model where there are no photos and nothing is asked
for: the two can hardly be told apart."""

HEADINGS = (
    *("axis", "variant", "PSNR", "lost dB", "SSIM", "FLIP", "fp64 error", "largest"),
    *("Gaussians", "MB", "file MB", "ms", "peak MB", "front"),
)


def in_order(records: Sequence[Record]) -> list[Record]:
    """Records by axis, and within an axis by their measurement; the unchanged model comes first."""
    order = {axis: place for place, axis in enumerate((AS_IS, *AXES))}
    return sorted(records, key=lambda record: order[record.axis])


def lost(record: Record, first: Record) -> tuple[float, float | None] | None:
    """Mean and standard error over the views of the loss against the unchanged model, in dB.

    The error is ``None`` for a single view; ``None`` for a variant that cannot be rendered.
    """
    if not record.per_view or not first.per_view:
        return None
    pairs = zip(first.per_view, record.per_view, strict=True)
    losses = [before["psnr"] - after["psnr"] for before, after in pairs]
    count = len(losses)
    return mean(losses), stdev(losses) / count**0.5 if count > 1 else None


def is_tie(record: Record, first: Record) -> bool:
    """True if a loss is below its error or below the last digit shown."""
    found = lost(record, first)
    return found is not None and abs(found[0]) <= max(found[1] or 0.0, SAME_PSNR / 2)


def fronts(records: Sequence[Record]) -> Mapping[str, set[str]]:
    """Names of the variants that no other beats, by cost: MB and ms."""
    found = {"MB": size_front(records), "ms": time_front(records)}
    return {cost: {point.name for point in points} for cost, points in found.items()}


def documents(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Plain data of every variant."""
    first, unbeaten = _first(records), fronts(records)
    found = []
    for record in in_order(records):
        loss = lost(record, first)
        name = f"{record.axis}: {record.name}"
        timed = first if record.draws_alike else record
        found.append(
            {
                "axis": record.axis,
                "name": record.name,
                **record.means,
                "flip": record.flip,
                "psnr_lost": None if loss is None else loss[0],
                "psnr_lost_error": None if loss is None else loss[1],
                "is_tie": is_tie(record, first),
                "relative_l2": record.relative_l2,
                "max_error": record.max_error,
                "num_gaussians": record.num_gaussians,
                "floats": record.floats,
                "bytes": record.size,
                "parameter_bytes": record.parameter_bytes,
                "file_bytes": record.file_bytes,
                "file": record.file,
                "render_ms": timed.ms,
                "render_ms_spread": timed.ms_spread,
                "render_ms_least": min(timed.readings, default=None),
                "render_ms_is_own": not record.draws_alike,
                "peak_memory_mb": timed.peak_memory_mb,
                "on_front": sorted(cost for cost, names in unbeaten.items() if name in names),
                "command": " ".join(record.command),
                "failure": record.failure,
            }
        )
    return found


def metrics(record: Record) -> dict[str, float | None]:
    """Figures for TensorBoard's HParams page."""
    return {
        "psnr": record.psnr,
        "ssim": record.means.get("ssim"),
        "flip": record.flip,
        "megabytes": record.size / 1e6,
        "render_ms": record.ms,
        "peak_memory_mb": record.peak_memory_mb,
    }


def table(records: Sequence[Record]) -> Table:
    """A row for each variant."""
    first, unbeaten = _first(records), fronts(records)
    found, axis = [], ""
    for record in in_order(records):
        name = f"{record.axis}: {record.name}"
        places = ", ".join(cost for cost in ("MB", "ms") if name in unbeaten[cost])
        found.append(
            [
                "" if record.axis == axis else record.axis,
                "" if record.axis == AS_IS else record.name,
                *_accuracy(record, first),
                f"{record.num_gaussians:,}",
                f"{record.size / 1e6:.2f}",
                "" if record.file_bytes is None else f"{record.file_bytes / 1e6:.2f}",
                _milliseconds(record),
                _peak(record),
                "cannot be rendered" if record.failure else places,
            ]
        )
        axis = record.axis
    return Table(HEADINGS, found, "each left out by itself")


def offers(records: Sequence[Record], run: str, more: Sequence[str] = ()) -> list[Offer]:
    """The variants that can be rendered, as offers.

    Args:
        records: of the variants.
        run: as it is typed.
        more: further words of every command, for example the place of the data set.
    """
    first = _first(records)
    return [_offer(record, first, run, more) for record in records if record.psnr is not None]


def usual_wish(records: Sequence[Record]) -> tuple[Wish, str]:
    """The wish of a user who asks for nothing, and its words."""
    psnr = _first(records).psnr or 0.0
    if psnr == PSNR_MAX:
        words = f"at least {USUAL_LIKENESS:g} dB against the model as it is"
        return Wish(psnr=USUAL_LIKENESS), words
    return Wish(psnr=psnr - USUAL_LOSS), f"a loss of at most {USUAL_LOSS} dB"


def _offer(record: Record, first: Record, run: str, more: Sequence[str]) -> Offer:
    timed = first if record.draws_alike else record
    # A verb's file counts; where no verb makes the variant, its parameters; a render has no size.
    size = record.file_bytes if record.command else record.parameter_bytes
    words = ["gsfw", record.command[0], run, *record.command[1:], *more] if record.command else []
    return Offer(
        name=f"{record.axis} {record.name}",
        psnr=record.psnr or 0.0,
        megabytes=None if size is None else size / 1e6,
        ms=timed.ms,
        ms_spread=timed.ms_spread or 0.0,
        command=shlex.join(words),
    )


def _accuracy(record: Record, first: Record) -> list[str]:
    """PSNR, its loss, SSIM, FLIP and errors; all empty for a variant that cannot be rendered."""
    loss = lost(record, first)
    if loss is None or record.relative_l2 is None or record.max_error is None:
        return [""] * 6
    error = "" if loss[1] is None else f" ± {loss[1]:.2f}"
    said = "tie" if is_tie(record, first) else f"{loss[0]:.2f}{error}"
    return [
        f"{record.psnr:.2f}",
        "" if record.axis == AS_IS else said,
        f"{record.means['ssim']:.4f}" if "ssim" in record.means else "",
        "" if record.flip is None else f"{record.flip:.4f}",
        f"{record.relative_l2:.1e}",
        f"{record.max_error:.1e}",
    ]


def _milliseconds(record: Record) -> str:
    if record.draws_alike:
        return "as it is"
    if record.ms is None:
        return ""
    spread = "" if record.ms_spread is None else f" ± {record.ms_spread:.1f}"
    return f"{record.ms:.1f}{spread}"


def _peak(record: Record) -> str:
    if record.draws_alike:
        return "as it is"
    return "" if record.peak_memory_mb is None else f"{record.peak_memory_mb:.1f}"


def _first(records: Sequence[Record]) -> Record:
    return next(record for record in records if record.axis == AS_IS)
