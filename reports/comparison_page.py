"""Comparison page: table, curves on one axis, and views under a slider."""

from __future__ import annotations

import time
from collections.abc import Sequence

from gsfw.reports.chart import Chart, Curve, smoothed
from gsfw.reports.curves import time_chart
from gsfw.reports.markup import (
    NOTHING,
    Child,
    Markup,
    aspect,
    div,
    element,
    folded,
    note,
    section,
    span,
    table,
    webp_uri,
)
from gsfw.reports.page import write_page
from gsfw.reports.page_limit import within_limit
from gsfw.reports.pictures import Pictures, ViewPicture
from gsfw.reports.plain_text import image_sizes, setting_text
from gsfw.reports.run_comparison import QUALITY, RunComparison
from gsfw.reports.run_page import state, state_notes
from gsfw.reports.run_record import RunRecord, number

FILM_HEIGHT, SLIDE_HEIGHT = 300, 470
"""Most heights of films and of views side by side, in CSS pixels."""

MOST_ROWS = 200
"""Most views in the table of PSNR by view."""


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
    comparison = RunComparison(tuple(records))
    said = list(notes)
    for record, name in zip(records, names, strict=True):
        # Those that are not finished are among the reasons against a comparison.
        known = state_notes(record) if record.is_finished else []
        said += [f"{name}: {text}" for text in (*known, *record.problems)]

    def build(shown: Sequence[Pictures | None], left_out: str) -> str:
        title = f"{_scenes(records)}: {' and '.join(names)}"
        return write_page(title, _body(comparison, names, shown, views, said), left_out)

    return within_limit(build, pictures)


def _body(
    comparison: RunComparison,
    names: Sequence[str],
    pictures: Sequence[Pictures | None],
    views: Sequence[str],
    said: Sequence[str],
) -> list[Markup]:
    records, headline = comparison.records, _headline(comparison, names)
    header = element(
        "header",
        [
            div("over", f"gsfw report, {time.strftime('%d %B %Y')}"),
            element("h1", f"{_scenes(records)}: {len(records)} runs compared"),
            div("about", " · ".join(names)),
            element("p", headline, {"class": "summary"}) if headline else NOTHING,
        ],
    )
    return [
        header,
        _verdict(comparison, names),
        *(div("callout", note(text)) for text in said),
        _films(names, pictures),
        _table(comparison, names),
        _slides(names, pictures, views),
        _curves(records, names),
        _by_view(records, names),
        _settings(comparison, names),
    ]


def _scenes(records: Sequence[RunRecord]) -> str:
    return " and ".join(dict.fromkeys(record.scene for record in records))


def _headline(comparison: RunComparison, names: Sequence[str]) -> str:
    """The run with the best PSNR, in a sentence; empty if they cannot be compared."""
    figure = QUALITY[0]
    values = comparison.figures.get(figure, [])
    best = comparison.best(figure) if values else []
    if best.count(True) != 1:
        return ""
    first, *others = sorted((v for v in values if v is not None), reverse=True)
    more = figure.text(first - others[0])
    second = names[values.index(others[0])]
    name = names[best.index(True)]
    return f"{name} has the best PSNR, {figure.text(first)}: {more} more than {second}."


def _verdict(comparison: RunComparison, names: Sequence[str]) -> Markup:
    """Reasons why no run is called better than another; nothing if they can be compared."""
    reasons = comparison.why_not(names)
    if not reasons:
        return NOTHING
    head = "These runs cannot be compared by their figures, so none is marked as the better one."
    return div("callout", [element("p", text) for text in (head, *reasons)])


def _films(names: Sequence[str], pictures: Sequence[Pictures | None]) -> Markup:
    shown = []
    for name, found in zip(names, pictures, strict=True):
        if found is not None and found.orbit:
            image = element("img", NOTHING, {"src": webp_uri(found.orbit), "alt": name})
            width = min(aspect(found.orbit) * FILM_HEIGHT, 1100 / len(names))
            style = {"style": f"width:{width:.0f}px"}
            shown.append(element("figure", [image, element("figcaption", name)], style))
    return div("films", shown) if shown else NOTHING


def _table(comparison: RunComparison, names: Sequence[str]) -> Markup:
    """Figures by run; the best of each row is marked if they can be compared."""
    rows = []
    for figure, values in comparison.figures.items():
        cells = [element("td", figure.name)]
        for value, is_best in zip(values, comparison.best(figure), strict=True):
            text = "-" if value is None else figure.text(value)
            cells.append(element("td", text, {"class": "best" if is_best else None}))
        rows.append(element("tr", cells))
    facts = {
        "steps": [f"{record.steps_done:,}" for record in comparison.records],
        "images": [image_sizes(record.protocol) or "-" for record in comparison.records],
    }
    for name, texts in facts.items():
        rows.append(element("tr", [element("td", text) for text in (name, *texts)]))
    head = [
        element("th", [name, element("br"), state(record)], {"scope": "col"})
        for name, record in zip(names, comparison.records, strict=True)
    ]
    body = [element("thead", element("tr", [element("th", ""), *head])), element("tbody", rows)]
    listed = div("wide", element("table", body, {"class": "compared"}))
    return section("figures", "Figures", listed, _marks(comparison))


def _marks(comparison: RunComparison) -> str:
    """The meaning of the marks in the table."""
    if not comparison.is_comparable:
        return ""
    if comparison.is_same_machine:
        return "Green: the best of each row, and what is nearly as good."
    return (
        "Green: the best of each row, and what is nearly as good. Times and memory have no mark: "
        "the runs may be of different machines."
    )


def _slides(
    names: Sequence[str], pictures: Sequence[Pictures | None], views: Sequence[str]
) -> Markup:
    """The same views of two runs, one over the other."""
    if not views:
        text = "No view has images in all of these runs."
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
    """A menu for the run on one side."""
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
        Chart("Gaussians", "step", tuple(count), is_from_zero=True),
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


def _settings(comparison: RunComparison, names: Sequence[str]) -> Markup:
    """Settings that differ between the runs, those first that a user chose."""
    if not comparison.settings:
        text = "All settings of the runs are equal."
        return section("settings", "Settings", element("p", text))
    head = ["setting", *names]
    rows = {
        key: [element("code", key), *(element("code", setting_text(value)) for value in values)]
        for key, values in comparison.settings.items()
    }
    chosen = [rows[key] for key in comparison.chosen]
    following = [rows[key] for key in comparison.following]
    content = [table(head, chosen, "text")] if chosen else []
    if following:
        content.append(
            folded(f"{len(following)} more that follow from them", table(head, following, "text"))
        )
    return section("settings", "Settings that differ", content)
