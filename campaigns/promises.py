"""The table of promises, docs/results/reliability.md, from the records of all campaigns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from campaign import RESULTS, ROOT, Detail, Record

from gsfw.core.words import rough_duration

PAGE = ROOT / "docs" / "results" / "reliability.md"
HERE = Path(__file__).resolve().parent
DEFECTS, KEPT_BY_TESTS = HERE / "defects.yaml", HERE / "kept_by_tests.yaml"

INTRODUCTION = """# Reliability

gsfw makes promises about damaged inputs, interruptions, disks, networks, processors and long runs.
A campaign tries promises at scale; this page lists them with the counts of the last trial.
`python campaigns` runs all campaigns and writes this page, `python campaigns NAME` runs one, and
`python campaigns table` writes the page from the records in `campaigns/results/`. The tests run
short forms of the campaigns, with planted defects that the campaigns must find.

Figures and messages are those of the commit that a section names; later versions may word a message
in another way.
"""


@dataclass(frozen=True)
class Defect:
    """A defect that a campaign found and that is mended."""

    campaign: str
    defect: str
    test: str
    """The test that keeps it: ``tests/...py::test_name``."""


def defects() -> list[Defect]:
    """Read the defects that were found."""
    return [Defect(**each) for each in yaml.safe_load(DEFECTS.read_text()) or []]


@dataclass(frozen=True)
class Kept:
    """A promise that ordinary tests keep."""

    promise: str
    tests: list[str]
    """Each as ``tests/...py::test_name``."""


def kept_by_tests() -> list[Kept]:
    """Read the promises that ordinary tests keep."""
    return [Kept(**each) for each in yaml.safe_load(KEPT_BY_TESTS.read_text())]


def page(records: Sequence[Record], found: Sequence[Defect], kept: Sequence[Kept] = ()) -> str:
    """The page in Markdown."""
    return "\n".join(_lines(records, found, kept)) + "\n"


def write_page(records_folder: Path = RESULTS) -> Path:
    """Write the page from the records in a folder."""
    records = [Record.read(path) for path in sorted(records_folder.glob("*.json"))]
    PAGE.write_text(page(records, defects(), kept_by_tests()))
    return PAGE


def _lines(
    records: Sequence[Record], found: Sequence[Defect], kept: Sequence[Kept]
) -> Iterator[str]:
    yield INTRODUCTION
    promises = [each for record in records for each in record.promises]
    yield (
        f"{sum(each.holds for each in promises)} of {len(promises)} promises held when they were "
        f"last tried. Campaigns have found {len(found)} defects. All are fixed; each is listed "
        "below with its test.\n"
    )
    yield from _table(
        ("Promise", "How it is tried", "Figure", "Holds", "Date"),
        [
            (each.promise, each.method, each.figure, "yes" if each.holds else "**no**", record.date)
            for record in records
            for each in record.promises
        ],
    )
    if kept:
        yield "\n## Ordinary tests\n"
        yield "`pytest` and `pytest -m slow` test these promises at every change.\n"
        rows = [(each.promise, "<br>".join(f"`{test}`" for test in each.tests)) for each in kept]
        yield from _table(("Promise", "Tests"), rows)
    for record in records:
        yield f"\n## {record.campaign.replace('-', ' ').capitalize()}\n"
        duration = rough_duration(record.seconds)
        yield f"`{record.command}`, {record.date}, commit {record.commit}, {duration}."
        yield f"Machine: {record.machine}.\n"
        for detail in record.details:
            yield from _detail(detail)
        if record.failures:
            yield "Failures:\n"
            yield from (f"* {line}" for line in record.failures)
            yield ""
        mended = [each for each in found if each.campaign == record.campaign]
        if mended:
            yield "Defects that were found and fixed, each with its test:\n"
            yield from (f"* {each.defect} (`{each.test}`)" for each in mended)
            yield ""


def _detail(detail: Detail) -> Iterator[str]:
    yield f"{detail.title}\n"
    yield from _table(detail.columns, detail.rows)
    yield ""


def _table(columns: Sequence[str], rows: Sequence[Sequence[str | int | float]]) -> Iterator[str]:
    yield f"| {' | '.join(columns)} |"
    yield "|" + " --- |" * len(columns)
    for row in rows:
        yield f"| {' | '.join(map(_cell, row))} |"


def _cell(value: str | int | float) -> str:
    text = f"{value:,}" if isinstance(value, int) else f"{value}"
    return text.replace("|", "\\|").replace("\n", " ")
