"""Report of `gsfw prepare`: a document and a contact sheet beside the data set, and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.datamanagers.images import decode, read_header
from gsfw.preparation.check.contact_sheet import COLUMNS, ROWS, Tile, tiles_of, write_contact_sheet
from gsfw.preparation.check.examination import Examination
from gsfw.preparation.check.plan import Plan
from gsfw.preparation.check.report import describe, finding_lines, verdict_line
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.finding import Finding, Verdict, Weight, sorted_findings
from gsfw.preparation.preparation import Prepared
from gsfw.preparation.workspace import Workspace
from gsfw.preparation.writing.written_files import WrittenDataSet

UNPLACED = COLUMNS
"""Number of images without a camera on the sheet: one row."""
PREVIEW = (512, 512)
"""Pixels of an image that is kept for the sheet, which shows it smaller."""
NAME = 40
"""Largest number of letters of a name in a table."""


def document_of_preparation(
    inputs: Sequence[Path], place: Workspace, prepared: Prepared, examined: Examination | None
) -> dict[str, Any]:
    """Write the sheet and the document of a computed data set; the document.

    Args:
        inputs: photos and videos as the user gave them.
        place: the folder of the data set.
        prepared: the outcome of all stages.
        examined: the written data set; ``None`` where there is none.

    Raises:
        OutputError: a file cannot be written.
    """
    diagnosis = prepared.diagnosis
    body = {
        **diagnosis.document(),
        "data_set": prepared.written,
        "chosen": prepared.chosen,
        "seconds": {name: round(seconds, 2) for name, seconds in prepared.seconds.items()},
    }
    tiles = _unplaced(prepared)
    return _finish([str(path) for path in inputs], place, body, diagnosis.findings, tiles, examined)


def document_of_conversion(
    source: str, form: str, place: Workspace, converted: WrittenDataSet, examined: Examination
) -> dict[str, Any]:
    """Write the sheet and the document of a data set whose cameras were kept; the document.

    Args:
        source: path of the data set that was converted.
        form: its format, as the name of a data manager.
        place: the folder of the new data set.
        converted: the files that were written.
        examined: the written data set.

    Raises:
        OutputError: a file cannot be written.
    """
    body = {"format": form, "data_set": asdict(converted)}
    return _finish([source], place, body, (), [], examined)


def _finish(
    inputs: list[str],
    place: Workspace,
    body: dict[str, Any],
    findings: Sequence[Finding],
    tiles: list[Tile],
    examined: Examination | None,
) -> dict[str, Any]:
    """Add the check of the written data set, and write both files."""
    survey, checked, command = None, {}, ""
    suggested: Mapping[str, str] = {}
    if examined is not None:
        survey = examined.survey
        findings = sorted_findings([*findings, *examined.findings])
        plan = Plan.of(survey, findings, examined.config, "")
        data = {"data": str(place.path)}
        # Without steps=, the run is planned; with them, gsfw prepare has the size as well.
        command, suggested = plan.of_a_time().command(data), plan.settings(data)
        checked = {**describe(survey, plan), "notes": list(examined.notes)}
        tiles = [*tiles, *tiles_of(survey, findings, COLUMNS * ROWS - len(tiles), COLUMNS)]
    verdict = Verdict.of(findings)
    write_contact_sheet(place.sheet, place.path.resolve().name, verdict, survey, tiles)
    document = {
        "kind": "prepare",
        "inputs": inputs,
        "out": str(place.path),
        "verdict": verdict.value,
        **body,
        "check": checked,
        "findings": [finding.document() for finding in findings],
        "next": command if verdict is not Verdict.WILL_NOT_TRAIN else "",
        "suggested": suggested,
        "sheet": str(place.sheet),
        "versions": {name: metadata.version(name) for name in ("gsfw", "pycolmap")},
    }
    write_atomically(place.report, json_text(document, indent=1).encode())
    return document


def _unplaced(prepared: Prepared) -> list[Tile]:
    """Images without a camera, the first of each reason before the second of any."""
    queues: dict[str, list[Unregistered]] = {}
    for item in prepared.diagnosis.unregistered:
        queues.setdefault(item.reason, []).append(item)
    chosen: list[Unregistered] = []
    while len(chosen) < UNPLACED and any(queues.values()):
        for queue in queues.values():
            if queue and len(chosen) < UNPLACED:
                chosen.append(queue.pop(0))
    return [Tile(one.name, one.reason, Weight.LIMIT, *_preview(one.path)) for one in chosen]


def _preview(path: Path) -> tuple[Image.Image | None, str]:
    """An image for the sheet, and what to say where it does not decode."""
    try:
        image = Image.fromarray(decode(path, read_header(path), PREVIEW)).convert("RGB")
    except DataError:
        return None, "does not decode"
    image.thumbnail(PREVIEW)
    return image, ""


def _brief(name: str) -> str:
    """The end of a name, which tells more than its beginning, as much as a table has room for."""
    return name if len(name) <= NAME else f"...{name[-NAME:]}"


def unused_rows(document: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, reason and explanation of images without a camera, and of files that are not used."""
    unplaced = document.get("unregistered", [])
    rows = [(_brief(item["name"]), item["reason"], item["found"]) for item in unplaced]
    return rows + [
        (_brief(item["name"]), "left out", item["reason"]) for item in document.get("left_out", [])
    ]


def result_lines(document: Mapping[str, Any]) -> Iterator[str]:
    """Lines for people: notes, findings, the verdict, the sheet and the next command."""
    for note in [*document["data_set"].get("notes", ()), *document["check"].get("notes", ())]:
        yield f"note: {note}"
    for finding in document["findings"]:
        yield from finding_lines(finding)
    yield ""
    yield verdict_line(document)
    yield f"cameras, points and images: {document['sheet']}"
    if document["next"]:
        yield f"next: {document['next']}"
