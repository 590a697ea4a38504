"""Run page: the report of one run."""

from __future__ import annotations

import time
from collections.abc import Sequence

from gsfw.core.words import shell_argument
from gsfw.reports.curves import time_section, training_section
from gsfw.reports.figures import callouts, headline, protocol, tiles
from gsfw.reports.markup import NOTHING, Markup, aspect, div, element, span, webp_uri
from gsfw.reports.page import write_page
from gsfw.reports.page_limit import within_limit
from gsfw.reports.pictures import Pictures
from gsfw.reports.plain_text import growth
from gsfw.reports.provenance import environment_section, messages_section, settings_section
from gsfw.reports.requirements import requirements_section
from gsfw.reports.run_record import RunRecord
from gsfw.reports.run_state import State
from gsfw.reports.view_table import view_section

HERO_HEIGHT = 430
"""Most height of the images at the top, in CSS pixels."""


def run_page(record: RunRecord, pictures: Pictures | None, notes: list[str]) -> str:
    """The page of a run.

    Args:
        record: the facts of its folder.
        pictures: its images; ``None`` if there are none.
        notes: what the reader has to know of this page, as sentences.
    """
    said = [*state_notes(record), *notes, *record.problems]

    def build(shown: Sequence[Pictures | None], left_out: str) -> str:
        return write_page(
            f"{record.scene}: {record.method}", _body(record, shown[0], said), left_out
        )

    return within_limit(build, [pictures])


def _body(record: RunRecord, pictures: Pictures | None, said: list[str]) -> list[Markup]:
    return [
        _header(record),
        _hero(record, pictures),
        *callouts(record, said),
        protocol(record),
        view_section(record, pictures),
        training_section(record),
        time_section(record),
        requirements_section(record),
        messages_section(record),
        settings_section(record),
        environment_section(record),
    ]


def _header(record: RunRecord) -> Markup:
    settings = record.settings
    parts = [f"method {record.method}"]
    parts += [growth(str(settings["strategy"]))] if settings.get("strategy") else []
    parts += [f"rasterizer {settings['rasterizer']}"] if settings.get("rasterizer") else []
    device = record.environment.get("device") or settings.get("device")
    parts += [f"device {device}"] if device else []
    parts += [f"{record.steps_done:,} steps"] if record.steps_done else []
    return element(
        "header",
        [
            div("over", f"gsfw report, {time.strftime('%d %B %Y')}, {record.path.name}"),
            element("h1", [record.scene, state(record)]),
            div("about", " · ".join(parts)),
            element("p", headline(record), {"class": "summary"}),
        ],
    )


def state(record: RunRecord) -> Markup:
    """The state of the run, or that its result is not sound, in a word or two."""
    if not record.is_finished:
        return span("pill warn", "in training" if record.state is State.RUNNING else "not finished")
    if any(item.get("collapse") for item in record.findings):
        return span("pill bad", "not sound")
    return span("pill warn", "see findings") if record.findings else span("pill", "finished")


def state_notes(record: RunRecord) -> list[str]:
    """Sentences on what an unfinished run or one without held-out views lacks, with remedies."""
    path = shell_argument(record.path)
    if not record.is_finished:
        return [_unfinished(record, path)]
    if record.figure("views") == 0:
        return [
            "No view is held out, so the quality of new views is unknown: hold some out with "
            "holdout_every=8."
        ]
    if not record.per_view and record.figure("psnr") is None:
        return [f"This run was not evaluated. Measure it with: gsfw eval {path}"]
    return []


def _unfinished(record: RunRecord, path: str) -> str:
    """The progress of a run without final figures, and the command that goes on."""
    if record.steps_done >= record.steps > 0 and record.state is not State.RUNNING:
        return (
            f"All {record.steps:,} steps are done, but there are no final figures: the run was "
            f"stopped in its last evaluation, or callbacks.results was off. Make them with: "
            f"gsfw resume {path}"
        )
    of = f" of {record.steps:,}" if record.steps else ""
    progress = f"it has done {record.steps_done:,}{of} steps."
    step = record.evaluated_step
    figures = (
        f"Its figures are those after step {step:,}."
        if step is not None
        else "It was not evaluated yet."
    )
    if record.state is State.RUNNING:
        return f"This run is in training: {progress} {figures}"
    return (
        f"This run is not finished: {progress} {figures} If it was stopped, continue with: "
        f"gsfw resume {path}"
    )


def _hero(record: RunRecord, pictures: Pictures | None) -> Markup:
    """A film around the scene and the median view, beside the main figures."""
    shown: list[tuple[bytes, str, str]] = []
    if pictures is not None and pictures.orbit:
        words = "Around the scene while time passes" if pictures.is_moving else "Around the scene"
        shown.append((pictures.orbit, words, "film"))
    if pictures is not None and pictures.still:
        which = "the median view, " if pictures.is_still_median else ""
        words = f"Render of {which}{pictures.still_name}"
        shown.append((pictures.still, words, "still"))
    ratios = [aspect(content) for content, _, _ in shown]
    figures = []
    for (content, words, kind), ratio in zip(shown, ratios, strict=True):
        image = element("img", NOTHING, {"src": webp_uri(content), "alt": words})
        body = [image, element("figcaption", words)]
        # Widths in proportion to the ratios give all images one height; a sum below 1 leaves room.
        style = {"class": kind, "style": f"flex:{10 * ratio:.2f} 1 0"}
        figures.append(element("figure", body, style))
    width = f"{sum(ratios) * HERO_HEIGHT:.0f}px"
    limit = {"class": "pictures", "style": f"flex:1 1 {width};max-width:{width}"}
    pictured = [element("div", figures, limit)] if figures else []
    return div("hero", [*pictured, tiles(record)])
