"""Figures: the results of a run with their protocol, their baselines and what is not sound."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.reports.curves import baseline
from gsfw.reports.markup import NOTHING, Child, Markup, div, element, folded, span
from gsfw.reports.page import size_text
from gsfw.reports.run_record import RunRecord, number

BASELINES = (
    ("constant_psnr", "a single colour"),
    ("mean_image_psnr", "the mean image"),
    ("still_psnr", "an image that stands still"),
)
"""Keys of the baselines of all pixels, and their names."""


def headline(record: RunRecord) -> str:
    """The result in a sentence or two."""
    psnr, views = record.figure("psnr"), len(record.per_view) or record.summary.get("views")
    level, seconds = baseline(record, "constant_psnr"), record.figure("train_seconds")
    parts = []
    if psnr is not None:
        above = ""
        if level is not None:
            side = "above" if psnr >= level else "below"
            above = f", {abs(psnr - level):.1f} dB {side} a single colour"
        held_out = "1 held-out view" if views == 1 else f"{views or ''} held-out views".lstrip()
        parts.append(f"PSNR {psnr:.2f} dB on {held_out}{above}.")
    elif (trained := record.figure("training_psnr")) is not None:
        parts.append(f"PSNR {trained:.2f} dB on training views; none is held out.")
    count = record.num_gaussians
    if count:
        time = f", after {duration(seconds)} of training" if seconds else ""
        parts.append(f"{count:,.0f} Gaussians{time}.")
    return " ".join(parts) or "No figures were written."


def tiles(record: RunRecord) -> Markup:
    """The main figures, large."""
    shown = [*_quality(record), *_cost(record)]
    return div("tiles", [tile for tile in shown if tile])


def _quality(record: RunRecord) -> list[Markup]:
    levels = [
        f"{name} {value:.2f}"
        for key, name in BASELINES
        if (value := baseline(record, key)) is not None
    ]
    moving = baseline(record, "constant_moving_psnr")
    trained = "of some training views"
    step = record.evaluated_step
    early = f"after step {step:,}" if step is not None and not record.is_finished else ""
    return [
        _tile("PSNR", record.figure("psnr"), "dB", early or "; ".join(levels)),
        _tile("SSIM", record.figure("ssim"), digits=4),
        _tile(
            "PSNR of what moves",
            record.figure("moving_psnr"),
            "dB",
            "" if moving is None else f"a single colour {moving:.2f}",
        ),
        _tile("Training PSNR", record.figure("training_psnr"), "dB", trained),
    ]


def _cost(record: RunRecord) -> list[Markup]:
    seconds = record.figure("train_seconds")
    count = record.num_gaussians
    size, each = record.figure("model_bytes"), record.figure("bytes_per_time")
    memory = record.figure("peak_memory_mb")
    render = record.figure("render_ms")
    per_time = f"{size_text(round(each))} per captured time" if each else ""
    return [
        _text_tile("Gaussians", f"{count:,.0f}") if count else NOTHING,
        _text_tile("Training", duration(seconds), f"{record.steps_done:,} steps")
        if seconds
        else _text_tile("Steps", f"{record.steps_done:,}", f"of {record.steps:,}"),
        _text_tile("Model", size_text(round(size)), per_time) if size else NOTHING,
        _tile("One image", render, "ms", "to render, median", 1),
        _text_tile("Memory", f"{memory:,.0f} MB", "at most") if memory else NOTHING,
    ]


def _tile(
    what: str, value: float | None, unit: str = "", more: str = "", digits: int = 2
) -> Markup:
    return NOTHING if value is None else _text_tile(what, f"{value:.{digits}f}", more, unit)


def _text_tile(what: str, value: str, more: str = "", unit: str = "") -> Markup:
    shown: list[Child] = [value, span("unit", unit) if unit else ""]
    lines = [div("what", what), div("value", shown)]
    return div("tile", [*lines, div("more", more)] if more else lines)


def protocol(record: RunRecord) -> Markup:
    """How the figures were measured, and the definitions of the baselines."""
    known = record.evaluation.get("baselines")
    definitions = (
        {f"baseline: {key.replace('_', ' ')}": text for key, text in known.items()}
        if isinstance(known, Mapping)
        else {}
    )
    rows = {
        **{key.replace("_", " "): value for key, value in record.protocol.items()},
        **{key: text for key, text in definitions.items() if isinstance(text, str)},
    }
    if not rows:
        return NOTHING
    return folded("How these figures were measured", definition_list(rows))


def definition_list(rows: Mapping[str, object]) -> Markup:
    """Names and values."""
    return element(
        "dl", [[element("dt", key), element("dd", plain(value))] for key, value in rows.items()]
    )


def plain(value: object) -> str:
    """A value of a file for people."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {plain(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        if len(value) == 2 and all(isinstance(item, int) for item in value):
            return f"{value[0]} x {value[1]}"
        return ", ".join(map(plain, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    found = number(value)
    if found is not None:
        return f"{value:,}" if isinstance(value, int) else f"{found:.6g}"
    return "-" if value is None or value == "" else str(value)


def duration(seconds: float) -> str:
    """A time for people."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def callouts(record: RunRecord, notes: list[str]) -> list[Markup]:
    """Findings, and what the reader has to know of this page.

    Args:
        record: the run.
        notes: sentences.
    """
    return [*findings(record), *(div("callout", element("p", note)) for note in notes)]


def findings(record: RunRecord) -> list[Markup]:
    """What is not sound, or that nothing was found."""
    found = [
        div(
            "callout bad" if item.get("collapse") else "callout",
            element("p", str(item.get("message", ""))),
        )
        for item in record.findings
    ]
    is_judged = isinstance(record.evaluation.get("findings"), list)
    if is_judged and record.per_view and not found and record.is_finished:
        return [
            div(
                "callout good",
                element("p", "No findings: the checks of the result found nothing wrong."),
            )
        ]
    return found
