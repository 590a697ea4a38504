"""Run page: the report of one run."""

from __future__ import annotations

import time

from gsfw.reports.curves import time_section, training_section
from gsfw.reports.figures import figures_section, headline
from gsfw.reports.markup import NOTHING, Markup, div, element, span, webp_uri
from gsfw.reports.page import write_page
from gsfw.reports.pictures import Pictures
from gsfw.reports.provenance import environment_section, messages_section, settings_section
from gsfw.reports.requirements import requirements_section
from gsfw.reports.run_record import RunRecord
from gsfw.reports.view_table import view_section


def run_page(record: RunRecord, pictures: Pictures | None, notes: list[str]) -> str:
    """The page of a run.

    Args:
        record: the facts of its folder.
        pictures: its images; ``None`` if there are none.
        notes: what the reader has to know of this page, as sentences.
    """
    said = [*state_notes(record), *notes, *record.problems]
    body = [
        _header(record),
        _hero(pictures),
        figures_section(record, said),
        view_section(record, pictures),
        training_section(record),
        time_section(record),
        requirements_section(record),
        messages_section(record),
        settings_section(record),
        environment_section(record),
    ]
    return write_page(f"{record.scene}: {record.method}", body, _left_out(record, pictures))


def _left_out(record: RunRecord, pictures: Pictures | None) -> str:
    """The number of views without images."""
    shown = 0 if pictures is None else len(pictures.views)
    missing = len(record.per_view) - shown
    if not shown or missing <= 0:
        return ""
    return f"Images of {missing:,} of {len(record.per_view):,} views are left out for its size."


def _header(record: RunRecord) -> Markup:
    settings = record.settings
    parts = [record.method]
    parts += [str(settings[key]) for key in ("strategy", "rasterizer") if settings.get(key)]
    device = record.environment.get("device") or settings.get("device")
    parts += [f"on {device}"] if device else []
    parts += [f"{record.steps_done:,} steps"] if record.steps_done else []
    return element(
        "header",
        [
            div("over", f"gsfw report, {time.strftime('%d %B %Y')}, {record.folder.path.name}"),
            element("h1", [record.scene, state(record)]),
            div("about", " · ".join(parts)),
            element("p", headline(record), {"class": "summary"}),
        ],
    )


def state(record: RunRecord) -> Markup:
    """Whether the run is finished and its result sound, in a word or two."""
    if not record.is_finished:
        return span("pill warn", "not finished")
    if any(item.get("collapse") for item in record.findings):
        return span("pill bad", "not sound")
    return span("pill warn", "see findings") if record.findings else span("pill", "finished")


def state_notes(record: RunRecord) -> list[str]:
    """What an unfinished run or one without held-out views lacks, and what to do."""
    notes = []
    if not record.is_finished:
        of = f" of {record.steps:,}" if record.steps else ""
        step = record.evaluated_step
        figures = (
            f"its figures are those after step {step:,}"
            if step is not None
            else "it was not evaluated before"
        )
        notes.append(
            f"This run was stopped after {record.steps_done:,}{of} steps; {figures}. "
            f"Go on with: gsfw resume {record.folder.path}"
        )
    elif not record.per_view:
        notes.append(
            "No view is held out, so nothing tells how new views look: hold some out with "
            "holdout_every=8."
        )
    return notes


def _hero(pictures: Pictures | None) -> Markup:
    """The median view, and a film around the scene."""
    if pictures is None or not (pictures.still or pictures.orbit):
        return NOTHING
    shown = []
    if pictures.orbit:
        words = "Around the scene while time passes" if pictures.is_moving else "Around the scene"
        shown.append(_figure(pictures.orbit, words, "film"))
    if pictures.still:
        shown.append(_figure(pictures.still, f"Render of the median view, {pictures.still_name}"))
    return div("hero", shown)


def _figure(content: bytes, caption: str, kind: str = "still") -> Markup:
    """An image with its caption; readers who want no motion see no film."""
    image = element("img", NOTHING, {"src": webp_uri(content), "alt": caption})
    body = [div("frame", image), element("figcaption", caption)]
    return element("figure", body, {"class": kind})
