"""Run in a notebook: its figures and some of its views as HTML."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from gsfw.commands.interface.summary import Row, compared_views, quality_rows, run_rows
from gsfw.core.datamanager import Split, spread
from gsfw.core.embedded_image import image_element
from gsfw.core.errors import UserError
from gsfw.core.loop.evaluation import render_model
from gsfw.reports.markup import Markup, element

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition
    from gsfw.reports.run_record import RunRecord

MOST_VIEWS = 3
"""Views that are shown, photo and render side by side."""


def run_html(record: RunRecord, opened: Callable[[], Composition]) -> str:
    """The figures of a run, and some held-out views; without views if the data set is gone.

    Args:
        record: the facts of its folder.
        opened: opens the run for rendering.
    """
    lines = [Row("folder", str(record.path)), *_figures(record)]
    cells = [
        element("tr", [element("td", text) for text in (row.name, row.value, row.remark)])
        for row in lines
    ]
    title = f"{record.method} on {record.scene}, {record.steps_done} of {record.steps} steps"
    return element("div", [element("b", title), element("table", cells), _views(opened)])


def _figures(record: RunRecord) -> list[Row]:
    if record.is_finished:
        return run_rows(record.summary, record.metrics)
    means = {name: float(record.evaluation[name]) for name in record.metrics}
    views = compared_views(str(len(record.per_view)), "held-out", record.protocol)
    return quality_rows(means, record.evaluation.get("baselines", {}), views)


def _views(opened: Callable[[], Composition]) -> list[Markup]:
    """Photos and renders of some held-out views, or of training views if there are none."""
    try:
        composition = opened()
        data, parts, settings = composition.parts.data, composition.parts, composition.plan.settings
        split = Split.EVAL if len(data.views(Split.EVAL)) else Split.TRAIN
        shown: list[Markup] = []
        for index in spread(range(len(data.views(split))), MOST_VIEWS):
            (batch,) = data.load(split, [index], parts.device)
            rendered = render_model(
                parts.model, parts.rasterizer, batch.cameras, settings, batch.time
            )
            assert settings.background is not None
            name, photo = data.views(split).names[index], batch.target(settings.background)[0]
            images = (
                image_element(photo, f"{name}: photo"),
                image_element(rendered.color[0], f"{name}: render"),
            )
            shown.append(element("div", [Markup(image) for image in images]))
    except UserError:  # The figures are worth more than an error.
        return []
    return shown
