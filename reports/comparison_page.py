"""Comparison page: table, curves on one axis, and views under a slider."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gsfw.reports.chart import Chart, Curve, smoothed
from gsfw.reports.curves import baseline, time_chart
from gsfw.reports.figures import duration, plain
from gsfw.reports.markup import (
    NOTHING,
    Child,
    Markup,
    aspect,
    div,
    element,
    folded,
    section,
    span,
    table,
    webp_uri,
)
from gsfw.reports.page import size_text, write_page
from gsfw.reports.pictures import Pictures, ViewPicture
from gsfw.reports.run_page import state, state_notes
from gsfw.reports.run_record import RunRecord, number

UNALIKE = ("data", "split", "held_out", "views", "image_sizes", "background", "numerics")
"""Entries of the protocol that have to agree for figures to be comparable."""

FILM_HEIGHT, SLIDE_HEIGHT = 300, 470
"""Most heights of films and of views side by side, in CSS pixels."""

MOST_ROWS = 200
"""Most views in the table of PSNR by view."""


@dataclass(frozen=True)
class Row:
    """A figure of the table."""

    name: str
    value: Callable[[RunRecord], float | None]
    text: Callable[[float], str]
    better: int
    """1 where more is better, -1 where less is, 0 where neither is."""


ROWS = (
    Row("PSNR, dB", lambda run: run.figure("psnr"), lambda v: f"{v:.2f}", 1),
    Row("SSIM", lambda run: run.figure("ssim"), lambda v: f"{v:.4f}", 1),
    Row("PSNR of what moves, dB", lambda run: run.figure("moving_psnr"), lambda v: f"{v:.2f}", 1),
    Row("training PSNR, dB", lambda run: run.figure("training_psnr"), lambda v: f"{v:.2f}", 0),
    Row("a single colour, dB", lambda r: baseline(r, "constant_psnr"), lambda v: f"{v:.2f}", 0),
    Row("Gaussians", lambda run: run.num_gaussians, lambda v: f"{v:,.0f}", -1),
    Row("model", lambda run: run.figure("model_bytes"), lambda v: size_text(round(v)), -1),
    Row("training", lambda run: run.figure("train_seconds"), duration, -1),
    Row("to render an image, ms", lambda run: run.figure("render_ms"), lambda v: f"{v:.1f}", -1),
    Row("memory at most, MB", lambda r: r.figure("peak_memory_mb"), lambda v: f"{v:,.0f}", -1),
    Row("steps", lambda run: float(run.steps_done), lambda v: f"{v:,.0f}", 0),
)


def comparison_page(
    records: Sequence[RunRecord],
    names: Sequence[str],
    pictures: Sequence[Pictures | None],
    views: Sequence[str],
    notes: Sequence[str],
) -> str:
    """The page.

    Args:
        records: the runs, at least two.
        names: of the runs; all different.
        pictures: images of each run; ``None`` if it has none.
        views: names of the views that are shown side by side.
        notes: what the reader has to know, as sentences.
    """
    said = [*unalike(records, names), *notes]
    for record, name in zip(records, names, strict=True):
        said += [f"{name}: {note}" for note in (*state_notes(record), *record.problems)]
    scenes = list(dict.fromkeys(record.scene for record in records))
    header = element(
        "header",
        [
            div("over", f"gsfw report, {time.strftime('%d %B %Y')}"),
            element("h1", f"{' and '.join(scenes)}: {len(records)} runs compared"),
            div("about", " · ".join(names)),
        ],
    )
    body = [
        header,
        *(div("callout", element("p", note)) for note in said),
        _films(names, pictures),
        _table(records, names),
        _slides(names, pictures, views),
        _curves(records, names),
        _by_view(records, names),
        _settings(records, names),
    ]
    return write_page(f"{' and '.join(scenes)}: {' and '.join(names)}", body)


def unalike(records: Sequence[RunRecord], names: Sequence[str]) -> list[str]:
    """What makes figures incomparable, as sentences; empty if they were measured alike."""
    found: list[str] = []
    if not all(record.protocol for record in records):
        return found
    for key in UNALIKE:
        values = [
            data_name(record) if key == "data" else plain(record.protocol.get(key))
            for record in records
        ]
        if len(set(values)) > 1:
            each = "; ".join(f"{name}: {value}" for name, value in zip(names, values, strict=False))
            words = key.replace("_", " ")
            found.append(f"The figures were not measured alike: {words} differs ({each}).")
    return found


def data_name(record: RunRecord) -> str:
    """Name of the data set without its place, which differs between machines."""
    return Path(str(record.settings.get("data") or "")).name or "built-in scene"


def _films(names: Sequence[str], pictures: Sequence[Pictures | None]) -> Markup:
    shown = []
    for name, found in zip(names, pictures, strict=True):
        if found is not None and found.orbit:
            image = element("img", NOTHING, {"src": webp_uri(found.orbit), "alt": name})
            width = min(aspect(found.orbit) * FILM_HEIGHT, 1100 / len(names))
            style = {"style": f"width:{width:.0f}px"}
            shown.append(element("figure", [image, element("figcaption", name)], style))
    return div("films", shown) if shown else NOTHING


def _table(records: Sequence[RunRecord], names: Sequence[str]) -> Markup:
    """Figures by run; the best of each row is marked."""
    rows = []
    for row in ROWS:
        values = [row.value(record) for record in records]
        known = [value for value in values if value is not None]
        if not known:
            continue
        best = max(known, key=lambda value: row.better * value)
        is_won = row.better != 0 and len(known) == len(values) and len(set(known)) > 1
        cells = [element("td", row.name)]
        for value in values:
            text = "-" if value is None else row.text(value)
            won = is_won and value is not None and row.text(value) == row.text(best)
            cells.append(element("td", text, {"class": "best" if won else None}))
        rows.append(element("tr", cells))
    head = [
        element("th", [name, element("br"), state(record)], {"scope": "col"})
        for name, record in zip(names, records, strict=True)
    ]
    body = [element("thead", element("tr", [element("th", ""), *head])), element("tbody", rows)]
    listed = div("wide", element("table", body, {"class": "compared"}))
    return section("figures", "Figures", listed, "The best of each row is green.")


def _slides(
    names: Sequence[str], pictures: Sequence[Pictures | None], views: Sequence[str]
) -> Markup:
    """The same views of two runs, one over the other."""
    if not views:
        text = "The runs have no view in common that there are images of."
        return section("views", "Side by side", element("p", text))
    found = [
        {view.name: view for view in item.views} if item is not None else {} for item in pictures
    ]
    options = [*names, "ground truth"]
    menus = [_menu("left", options, 0), _menu("right", options, 1)]
    slides = [
        _slide(view, [known[view] for known in found])
        for view in views
        if all(view in known for known in found)
    ]
    lead = (
        "Drag across an image: the first run is left of the line, the second right of it. The "
        "views whose PSNR differs most come first."
    )
    content = [div("choose", menus), div("pairs", slides)]
    return section("views", "Side by side", content, lead)


def _menu(side: str, options: Sequence[str], chosen: int) -> Markup:
    """Which run is on a side."""
    listed = [
        element("option", text, {"value": place, "selected": place == chosen})
        for place, text in enumerate(options)
    ]
    label = f"{side} "
    return element("label", [label, element("select", listed, {"data-side": side})])


def _slide(name: str, views: Sequence[ViewPicture]) -> Markup:
    """One view: all runs and the photo, of which two show."""
    images = [*((view.rendered, place) for place, view in enumerate(views))]
    images.append((views[0].target, len(views)))
    sides = {0: "left", 1: "right"}
    layers: list[Child] = [
        element(
            "img",
            NOTHING,
            {"src": webp_uri(content), "data-run": place, "class": sides.get(place), "alt": name},
        )
        for content, place in images
    ]
    attributes = {"type": "range", "min": 0, "max": 100, "value": 50, "step": "any"}
    slider = element("input", NOTHING, {**attributes, "aria-label": f"border in {name}"})
    layers += [span("side l"), span("side r"), slider]
    figures = " | ".join(f"{view.psnr:.2f}" for view in views)
    caption = element("figcaption", f"{name}, PSNR {figures} dB")
    width = min(aspect(views[0].target) * SLIDE_HEIGHT, 545)
    style = {"class": "pair", "style": f"width:{width:.0f}px"}
    return element("figure", [div("slide", layers), caption], style)


def _curves(records: Sequence[RunRecord], names: Sequence[str]) -> Markup:
    """Loss, PSNR and counts of all runs on one axis each."""
    loss, psnr, count = [], [], []
    for place, (record, name) in enumerate(zip(records, names, strict=True)):
        loss.append(Curve(name, smoothed(record.series("loss")), place))
        psnr.append(Curve(name, record.series("eval/psnr"), place, "dots"))
        count.append(Curve(name, record.series("num_gaussians"), place))
    values = [value for curve in loss for _, value in curve.points]
    charts = [
        Chart("PSNR of held-out views", "step", tuple(psnr), unit="dB"),
        Chart("Loss", "step", tuple(loss), is_ratio=bool(values) and min(values) > 0),
        Chart("Gaussians", "step", tuple(count)),
        time_chart(list(records), tuple(names)),
    ]
    drawn = [chart.markup() for chart in charts if chart is not None]
    if not any(drawn):
        return NOTHING
    lead = "Losses are means over neighbouring logged steps."
    return section("training", "Training", div("charts", drawn), lead)


def _by_view(records: Sequence[RunRecord], names: Sequence[str]) -> Markup:
    """PSNR of each view in each run."""
    by_run = [
        {str(view["name"]): number(view.get("psnr")) for view in record.per_view}
        for record in records
    ]
    shared = [name for name in by_run[0] if all(name in known for known in by_run)]
    if not shared:
        return NOTHING
    rows = []
    for view in shared[:MOST_ROWS]:
        values = [known[view] for known in by_run]
        rows.append([view, *("-" if value is None else f"{value:.2f}" for value in values)])
    left_out = len(shared) - len(rows)
    more = f"; {left_out:,} better ones are left out" if left_out else ""
    title = f"PSNR of {len(shared):,} views, those that are worst in {names[0]} first{more}"
    return section("by-view", "View by view", folded(title, table(["view", *names], rows)))


def _settings(records: Sequence[RunRecord], names: Sequence[str]) -> Markup:
    """Settings that differ between the runs, those first that a user gave."""
    given: list[list[Markup]] = []
    others: list[list[Markup]] = []
    for key in dict.fromkeys(key for record in records for key in record.settings):
        values = [
            plain(record.settings[key]) if key in record.settings else "-" for record in records
        ]
        if len(set(values)) > 1:
            row = [element("code", key), *(element("code", value) for value in values)]
            (given if any(key in record.given for record in records) else others).append(row)
    if not given and not others:
        text = "All settings of the runs are equal."
        return section("settings", "Settings", element("p", text))
    head = ["setting", *names]
    content = [table(head, given, "text")] if given else []
    if others:
        title = f"{len(others)} more that follow from them"
        content.append(folded(title, table(head, others, "text")))
    return section("settings", "Settings that differ", content)
