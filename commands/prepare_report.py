"""What `gsfw prepare` says: a document beside the data set, a contact sheet, and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from gsfw.commands.check_report import describe, tell_findings
from gsfw.commands.console import Console
from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.datamanagers.images import decode, read_header
from gsfw.plugins.settings import Settings
from gsfw.plugins.specs import PROJECT
from gsfw.preparation.check.contact_sheet import COLUMNS, ROWS, write_contact_sheet
from gsfw.preparation.check.examination import Examination
from gsfw.preparation.check.plan import Plan
from gsfw.preparation.check.tile import Tile, tiles_of
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.finding import Finding, Verdict, Weight, sorted_findings
from gsfw.preparation.preparation import Prepared
from gsfw.preparation.workplace import Workplace

if TYPE_CHECKING:
    from gsfw.preparation.writing.written_data_set import WrittenDataSet

UNPLACED = COLUMNS
"""So many pictures without a camera are on the sheet: one row."""
NAME = 40
"""So many letters of a name are in a table."""
ROWS_SHOWN = 20
"""So many files that are not used are listed."""


def document_of_preparation(
    inputs: Sequence[Path], place: Workplace, prepared: Prepared, settings: Settings | None
) -> dict[str, Any]:
    """Look at the data set, write the sheet and the document beside it; the document.

    Args:
        inputs: what was given.
        place: where the data set is.
        prepared: how it came to be.
        settings: to open it with; ``None`` where there is none.
    """
    diagnosis = prepared.diagnosis
    body = {
        **diagnosis.document(),
        "data_set": prepared.written,
        "chosen": prepared.chosen,
        "seconds": {name: round(seconds, 2) for name, seconds in prepared.seconds.items()},
    }
    tiles = _unplaced(prepared)
    return _finish([str(path) for path in inputs], place, body, diagnosis.findings, tiles, settings)


def document_of_conversion(
    source: Settings, place: Workplace, converted: WrittenDataSet, settings: Settings
) -> dict[str, Any]:
    """The same of a data set whose cameras were kept."""
    body = {"format": source.choices["datamanager"].name, "data_set": asdict(converted)}
    return _finish([source.config.data], place, body, (), [], settings)


def _finish(
    inputs: list[str],
    place: Workplace,
    body: dict[str, Any],
    findings: Sequence[Finding],
    tiles: list[Tile],
    settings: Settings | None,
) -> dict[str, Any]:
    """Add what the check says of the written data set, and write everything."""
    survey, checked, command = None, {}, ""
    if settings is not None:
        examined = Examination.of(settings, None)
        survey = examined.survey
        findings = sorted_findings([*findings, *examined.findings])
        plan = Plan.of(survey, findings, settings.config, "")
        command = plan.command({"data": str(place.path)})
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
        "sheet": str(place.sheet),
        "versions": {name: metadata.version(name) for name in (PROJECT, "pycolmap")},
    }
    write_atomically(place.report, json_text(document, indent=1).encode())
    return document


def _unplaced(prepared: Prepared) -> list[Tile]:
    """Pictures without a camera, the first of each reason before the second of any."""
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
    """A picture for the sheet, and what to say where it does not decode."""
    try:
        return Image.fromarray(decode(path, read_header(path))).convert("RGB"), ""
    except DataError:
        return None, "does not decode"


def _brief(name: str) -> str:
    """The end of a name, which tells more than its beginning, as much as a table has room for."""
    return name if len(name) <= NAME else f"...{name[-NAME:]}"


def tell(console: Console, document: Mapping[str, Any]) -> None:
    """The document for people."""
    console.say()
    for sentence in document.get("figures", ()):
        console.say(sentence)
    _tell_unplaced(console, document)
    for note in [*document["data_set"].get("notes", ()), *document["check"].get("notes", ())]:
        console.say(f"note: {note}")
    tell_findings(console, document)
    console.say(f"cameras, points and pictures: {document['sheet']}")
    if document["next"]:
        console.say(f"next: {document['next']}")


def _tell_unplaced(console: Console, document: Mapping[str, Any]) -> None:
    """A table of pictures without a camera, and of files that are no pictures."""
    unplaced = document.get("unregistered", [])
    rows = [(_brief(item["name"]), item["reason"], item["found"]) for item in unplaced]
    rows += [
        (_brief(item["name"]), "left out", item["reason"]) for item in document.get("left_out", [])
    ]
    if not rows:
        return
    console.table(["not used", "reason", ""], rows[:ROWS_SHOWN])
    if len(rows) > ROWS_SHOWN:
        console.say(f"and {len(rows) - ROWS_SHOWN} more: {Path(document['out']) / 'prepare.json'}")
