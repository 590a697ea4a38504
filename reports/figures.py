"""Figures: the results of a run with their protocol, their baselines and what is not sound."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.core.loop.baselines import NAMES
from gsfw.core.words import duration, metric_name, size
from gsfw.reports.markup import NOTHING, Child, Markup, div, element, folded, note, span
from gsfw.reports.plain_text import image_sizes, metric_text, plain
from gsfw.reports.run_record import RunRecord

OWN_TILES = ("psnr", "ssim", "moving_psnr")
"""Metrics with tiles of their own words; those of plugins follow them."""

MOST_OTHERS = 3
"""Most tiles of other metrics; the table of views and the comparison have more."""


def headline(record: RunRecord) -> str:
    """The result in a sentence or two."""
    psnr, views = record.figure("psnr"), len(record.per_view) or record.summary.get("views")
    level, seconds = record.baseline("constant_psnr"), record.figure("train_seconds")
    parts = []
    if psnr is not None:
        above = ""
        if level is not None:
            side = "more" if psnr >= level else "less"
            above = f", {abs(psnr - level):.1f} dB {side} than an image of one colour"
        held_out = "1 held-out view" if views == 1 else f"{views or ''} held-out views".lstrip()
        sizes = image_sizes(record.protocol)
        of = f" of {sizes}" if sizes else ""
        parts.append(f"PSNR {psnr:.2f} dB on {held_out}{of}{above}.")
    elif (trained := record.figure("training_psnr")) is not None:
        parts.append(f"PSNR {trained:.2f} dB on training views; none is held out.")
    count = record.figure("num_gaussians")
    if count:
        time = f", after {duration(seconds)} of training" if seconds else ""
        parts.append(f"{count:,.0f} Gaussians{time}.")
    return " ".join(parts) or "The run has no figures yet."


def tiles(record: RunRecord) -> Markup:
    """The main figures, large."""
    shown = [*_quality(record), *_cost(record)]
    return div("tiles", [tile for tile in shown if tile])


def _quality(record: RunRecord) -> list[Markup]:
    sizes = image_sizes(record.protocol)
    levels = [
        f"{name} {value:.2f}"
        for key, name in NAMES.items()
        if (value := record.baseline(key)) is not None
    ]
    moving = record.baseline("constant_moving_psnr")
    trained = "of some training views"
    if "distractors" in record.protocol:
        trained += ", without distractors"
    step = record.evaluated_step
    if step is not None and not record.is_finished:
        levels = [f"after step {step:,}"]
    remarks = [sizes, *levels] if sizes else levels
    return [
        _tile("PSNR", record.figure("psnr"), "dB", "; ".join(remarks)),
        _tile("SSIM", record.figure("ssim"), "", "1: like the photos", 4),
        _tile(
            "PSNR of the moving region",
            record.figure("moving_psnr"),
            "dB",
            "" if moving is None else f"{NAMES['constant_psnr']} {moving:.2f}",
        ),
        *_others(record),
        _tile("Training PSNR", record.figure("training_psnr"), "dB", trained),
    ]


def _others(record: RunRecord) -> list[Markup]:
    """Tiles of the metrics of plugins."""
    names = [name for name in record.metrics if name not in OWN_TILES and "moving" not in name]
    return [
        _text_tile(metric_name(name), metric_text(name, value))
        for name in names[:MOST_OTHERS]
        if (value := record.figure(name)) is not None
    ]


def _cost(record: RunRecord) -> list[Markup]:
    seconds = record.figure("train_seconds")
    count = record.figure("num_gaussians")
    model, each = record.figure("model_bytes"), record.figure("bytes_per_time")
    memory = record.figure("peak_memory_mb")
    render = record.figure("render_ms")
    per_time = f"{size(each)} per captured time" if each else ""
    return [
        _text_tile("Gaussians", f"{count:,.0f}") if count else NOTHING,
        _text_tile("Training", duration(seconds), f"{record.steps_done:,} steps")
        if seconds
        else _text_tile("Steps", f"{record.steps_done:,}", f"of {record.steps:,}"),
        _text_tile("Model", size(model), per_time) if model else NOTHING,
        _tile("One image", render, "ms", "to render, median", 1),
        _text_tile("Memory", size(1e6 * memory), "at most") if memory else NOTHING,
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
    """The rules by which the figures were measured, and the definitions of the baselines."""
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


def callouts(record: RunRecord, notes: list[str]) -> list[Markup]:
    """Findings, and what the reader has to know of this page.

    Args:
        record: the run.
        notes: sentences.
    """
    return [*findings(record), *(div("callout", note(text)) for text in notes)]


def findings(record: RunRecord) -> list[Markup]:
    """Signs that the result is not sound, or that there are none."""
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
                element("p", "The checks of this result found nothing wrong."),
            )
        ]
    return found
