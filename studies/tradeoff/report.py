"""Report: what was measured, as a document, as CSV, and as lines for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from statistics import mean, stdev
from typing import Any

from gsfw.studies.tradeoff.front import SAME_PSNR, size_front, time_front
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS, AXES

HEADINGS = (
    *("axis", "variant", "PSNR", "lost dB", "SSIM", "FLIP", "fp64 error", "largest"),
    *("Gaussians", "MB", "file MB", "ms", "peak MB", "front"),
)


def in_order(records: Sequence[Record]) -> list[Record]:
    """By axis, and within an axis as they were measured; the model as it is comes first."""
    order = {axis: place for place, axis in enumerate((AS_IS, *AXES))}
    return sorted(records, key=lambda record: order[record.axis])


def lost(record: Record, first: Record) -> tuple[float, float | None] | None:
    """Decibels lost against the model as it is, view by view: the mean and its standard error.

    The error is ``None`` for a single view; all is ``None`` where a variant cannot be drawn.
    """
    if not record.per_view or not first.per_view:
        return None
    pairs = zip(first.per_view, record.per_view, strict=True)
    losses = [before["psnr"] - after["psnr"] for before, after in pairs]
    count = len(losses)
    return mean(losses), stdev(losses) / count**0.5 if count > 1 else None


def is_tie(record: Record, first: Record) -> bool:
    """Whether a loss cannot be told from none: it is below its error, or the last digit shown."""
    found = lost(record, first)
    return found is not None and abs(found[0]) <= max(found[1] or 0.0, SAME_PSNR / 2)


def fronts(records: Sequence[Record]) -> Mapping[str, set[str]]:
    """Names of the variants that nothing beats, by what they cost: MB and ms."""
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
    """The figures by which variants are told apart at a glance."""
    return {
        "psnr": record.psnr,
        "ssim": record.means.get("ssim"),
        "flip": record.flip,
        "megabytes": record.size / 1e6,
        "render_ms": record.ms,
        "peak_memory_mb": record.peak_memory_mb,
    }


def csv_text(records: Sequence[Record]) -> str:
    """The same as CSV."""
    buffer = io.StringIO()
    rows = [{**row, "on_front": " ".join(row["on_front"])} for row in documents(records)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(buffer, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def lines(records: Sequence[Record]) -> list[list[str]]:
    """Rows of a table for people, under ``HEADINGS``."""
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
                "cannot be drawn" if record.failure else places,
            ]
        )
        axis = record.axis
    return found


def _accuracy(record: Record, first: Record) -> list[str]:
    """PSNR, what is lost of it, SSIM, FLIP and errors; all empty for what cannot be drawn."""
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
