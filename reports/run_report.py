"""Run report: the page of one run, from its files and, where it can be opened, its model."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.errors import DataError, OutputError, UserError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.progress import stage
from gsfw.reports.drawing import DrawingRule, Model, draw_pictures
from gsfw.reports.error_image import choose_error
from gsfw.reports.pictures import Pictures, store_pictures, stored_pictures
from gsfw.reports.run_page import run_page
from gsfw.reports.run_reader import read_run
from gsfw.reports.run_record import RunRecord

logger = logging.getLogger("gsfw.run")

QUICK_FRAMES = 24
"""Frames of the film that ends a training; gsfw report has more."""

MOST_VIEWS = 9
"""Most views with images, unless another number is given."""


@dataclass(frozen=True)
class Opened:
    """A run's model, or why there is none."""

    model: Model | None
    why_not: str = ""
    """Cause, as a sentence; empty if the model was not asked for."""


def not_opened(error: UserError) -> Opened:
    """No model, because of an error."""
    return Opened(None, " ".join(f"{error.message} {error.advice}".split()))


def write_run_report(
    folder: RunFolder, opened: Opened, rule: DrawingRule, out: Path | None = None
) -> Path:
    """Write the page of a run.

    Args:
        folder: folder of the run.
        opened: its model; without one the images of an earlier report are shown.
        rule: what to draw.
        out: the page; ``None`` for ``report.html`` in the folder.

    Raises:
        OutputError: it cannot be written.
    """
    record = read_run(folder)
    notes: list[str] = []
    pictures = find_pictures(record, opened, rule, notes)
    with stage("writing the report"):
        path = folder.report if out is None else out
        write_atomically(path, run_page(record, pictures, notes).encode())
    return path


def find_pictures(
    record: RunRecord, opened: Opened, rule: DrawingRule, notes: list[str]
) -> Pictures | None:
    """Images that are drawn now, or those of an earlier report; ``None`` if there are none.

    Args:
        record: the facts of the run.
        opened: its model.
        rule: what to draw.
        notes: receives what the reader has to know of the images.
    """
    if opened.model is not None:
        worst_first = [str(view["name"]) for view in record.per_view]
        try:
            pictures = draw_pictures(opened.model, worst_first, rule)
        except UserError as error:  # Such as an image of the data that is no longer there.
            opened = not_opened(error)
        else:
            if pictures.views or pictures.orbit:
                _store(record, pictures)
            _note_step(record, pictures, notes)
            return pictures
    try:
        found = stored_pictures(record.folder)
    except DataError as error:
        notes.append(f"There are no images: {error.message} {opened.why_not}".strip())
        return None
    if found is None:
        notes.append(f"There are no images: {opened.why_not or 'none were asked for.'}")
    elif opened.why_not:
        notes.append(f"The images are those of an earlier report: {opened.why_not}")
    if found is not None:
        _note_step(record, found, notes)
    return found


def _store(record: RunRecord, pictures: Pictures) -> None:
    """Keep the images in the run for later pages; a page needs none of these files."""
    try:
        store_pictures(record.folder, pictures)
    except OutputError as error:
        logger.warning("%s The images are not kept for images=stored.", error.message)


def _note_step(record: RunRecord, pictures: Pictures, notes: list[str]) -> None:
    """Say when images and figures are of different steps."""
    step = record.evaluated_step
    if step is not None and step != pictures.step:
        notes.append(
            f"Images show the model after step {pictures.step:,}; the figures of views are those "
            f"after step {step:,}."
        )


def report_training(trainer: Trainer) -> None:
    """Write the page of a run that has ended; a failure does not fail the run.

    A run that was stopped gets none: somebody wants it to end now.
    """
    if trainer.control.stop_reason is not None:
        return
    model = Model(trainer.parts, trainer.plan.settings, trainer.step)
    # The absolute error takes no time; FLIP takes about a second for each view.
    rule = DrawingRule(MOST_VIEWS, QUICK_FRAMES, choose_error("absolute"))
    try:
        write_run_report(trainer.folder, Opened(model), rule)
    except UserError as error:
        logger.warning("no report was written: %s", error.message)
    except Exception as error:  # The run is finished: all that matters of it is written.
        kind = type(error).__name__
        logger.warning("no report was written: %s: %s", kind, error, exc_info=True)
