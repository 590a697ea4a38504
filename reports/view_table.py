"""View table: every compared view, the worst first, some with photo, render and error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from gsfw.core.words import counted, metric_name, shown_metrics
from gsfw.reports.markup import (
    NOTHING,
    Child,
    Markup,
    aspect,
    div,
    element,
    folded,
    join,
    section,
    span,
    table,
    webp_uri,
)
from gsfw.reports.pictures import Pictures, ViewPicture
from gsfw.reports.plain_text import metric_text
from gsfw.reports.run_record import RunRecord, number

KINDS = (("target", "ground truth"), ("rendered", "render"), ("error", "error"))

MOST_ROWS = 400
"""Most views that are listed: the worst ones."""

IMAGE_HEIGHT = 220
"""Most height of an image in the table, in CSS pixels; small images are enlarged to it."""

SHORT = 4
"""Stretches of up to so many views without images are not folded."""

MEDIUM = 20
"""The same on a page without images, which is short."""

MOST_FIGURES = 5
"""Most columns of figures; the result files have all of them."""

View = Mapping[str, Any]


def view_section(record: RunRecord, pictures: Pictures | None) -> Markup:
    """The table, and what its images show."""
    views = record.per_view
    drawn = {} if pictures is None else {view.name: view for view in pictures.views}
    if not views and pictures is not None and pictures.views:
        views = [{"name": view.name, "psnr": view.psnr} for view in pictures.views]
    if not views:
        return section("views", "Views", element("p", "No view was compared."))
    is_trained = pictures is not None and pictures.split == "train" and not record.per_view
    split = "training" if is_trained else "held-out"
    names = shown_metrics(figure_names(views), record.protocol)[:MOST_FIGURES]
    body = [_stretch(part, names, drawn, _range(views)) for part in _stretches(views, drawn)]
    left_out = len(views) - MOST_ROWS
    if left_out > 0:
        body.append(element("p", f"{left_out:,} better views are left out.", {"class": "lead"}))
    if record.per_view:
        return section(
            "views", "Held-out views, the worst first", body, _lead(views, drawn, pictures)
        )
    assert pictures is not None
    lead: list[Child] = [
        f"{len(views)} {split} views, drawn and compared for this page. Click one to see it large.",
        _legend(pictures),
    ]
    return section("views", f"Some {split} views, the worst first", body, lead)


def figure_names(views: Sequence[View]) -> list[str]:
    """Names of the figures of views, in their order."""
    names = dict.fromkeys(
        name for view in views for name, value in view.items() if number(value) is not None
    )
    return list(names)


def _lead(
    views: Sequence[View], drawn: Mapping[str, ViewPicture], pictures: Pictures | None
) -> list[Child]:
    """The number of views with images, and the scale of the errors."""
    shown = sum(view["name"] in drawn for view in views)
    if pictures is None or not shown:
        return ["There are no images."]
    which = "All have images" if shown == len(views) else f"{shown} have images"
    labels = any(view.label for view in pictures.views)
    detail = ": the worst, some around the median, and the best" if labels else ""
    more = "" if shown == len(views) else ". gsfw report RUN views=N chooses how many"
    text = f"{counted(len(views), 'view')}. {which}{detail}{more}. Click one to see it large."
    return [text, _legend(pictures)]


def _legend(pictures: Pictures) -> Markup:
    """The scale of the error images."""
    return span("legend", [f"Error: {pictures.error}", span("scale")])


def _stretches(
    views: Sequence[View], drawn: Mapping[str, ViewPicture]
) -> Iterable[tuple[bool, list[View]]]:
    """Neighbouring views with images, and without, in turn."""
    stretch: list[View] = []
    for view in views[:MOST_ROWS]:
        if stretch and (stretch[-1]["name"] in drawn) != (view["name"] in drawn):
            yield stretch[-1]["name"] in drawn, stretch
            stretch = []
        stretch.append(view)
    if stretch:
        yield stretch[-1]["name"] in drawn, stretch


def _stretch(
    part: tuple[bool, list[View]],
    names: Sequence[str],
    drawn: Mapping[str, ViewPicture],
    limits: tuple[float, float],
) -> Markup:
    """A table of views that all have images, or that all have none."""
    with_images, views = part
    head = ["view", *(metric_name(name) for name in names)]
    if not with_images:
        listed = table(
            head, ([str(view["name"]), *_cells(view, names, limits)] for view in views), "rest"
        )
        if len(views) <= (SHORT if drawn else MEDIUM):
            return listed
        values = [value for view in views if (value := number(view.get("psnr"))) is not None]
        between = f", {min(values):.2f} to {max(values):.2f} dB" if values else ""
        more = "more " if drawn else ""
        return folded(f"{len(views):,} {more}views{between}", listed)
    titles = [element("th", text, {"scope": "col"}) for text in head]
    own = list(dict.fromkeys(name for view in views for name in drawn[view["name"]].own))
    kinds = [*(text for _, text in KINDS), *map(metric_name, own)]
    titles += [element("th", text, {"scope": "col", "class": "image"}) for text in kinds]
    rows = [element("tr", _row(view, names, drawn[view["name"]], own, limits)) for view in views]
    body = [element("thead", element("tr", titles)), element("tbody", rows)]
    return div("wide", element("table", body, {"class": "views"}))


def _row(
    view: View,
    names: Sequence[str],
    picture: ViewPicture,
    own: Sequence[str],
    limits: tuple[float, float],
) -> list[Markup]:
    """The cells of a view with images; ``own`` are the names of those of the method."""
    tag = div(f"tag {picture.label}", picture.label) if picture.label else NOTHING
    cells = [element("td", [div("name", str(view["name"])), tag])]
    for name, cell in zip(names, _cells(view, names, limits), strict=True):
        cells.append(element("td", [span("label", f"{metric_name(name)} "), cell]))
    images = [(text, getattr(picture, kind)) for kind, text in KINDS]
    images += [(metric_name(name), picture.own.get(name, b"")) for name in own]
    for text, content in images:
        if not content:
            cells.append(element("td", "-", {"class": "image"}))
            continue
        attributes = {
            "src": webp_uri(content),
            "style": f"width:{aspect(content) * IMAGE_HEIGHT:.0f}px",
            "alt": f"{view['name']}: {text}",
            "data-kind": text,
            "loading": "lazy",
        }
        image = element("img", NOTHING, attributes)
        cells.append(element("td", [image, span("label", text)], {"class": "image"}))
    return cells


def _cells(view: View, names: Sequence[str], limits: tuple[float, float]) -> list[Markup]:
    """The figures of a view; PSNR with a bar from the worst view to the best."""
    cells = []
    for name in names:
        value = number(view.get(name))
        shown = join("-" if value is None else metric_text(name, value))
        if name == "psnr" and value is not None and limits[1] > limits[0]:
            share = 0.04 + 0.96 * (value - limits[0]) / (limits[1] - limits[0])
            bar = element("i", NOTHING, {"style": f"width:{100 * share:.1f}%"})
            shown = join([shown, element("span", bar, {"class": "bar"})])
        cells.append(shown)
    return cells


def _range(views: Sequence[View]) -> tuple[float, float]:
    values = [value for view in views if (value := number(view.get("psnr"))) is not None]
    return (min(values), max(values)) if values else (0.0, 0.0)
