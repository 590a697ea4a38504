"""StressReport: what came of the catalogue of extremes, as tables and as a document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Any

from gsfw.commands.interface.console import Console
from gsfw.studies.stress.catalogue import CASES, chosen
from gsfw.studies.stress.moving_case import MOVING_CASES
from gsfw.studies.stress.plane import PlaneErrors
from gsfw.studies.stress.result import CaseResult, totals
from gsfw.studies.stress.runner import NAMES

COLUMNS = ("case", "forward", "relative", "gradient", "finite", "same bits", "verdict")

DIGEST = 46
"""Characters of a message in a table; the document has all of it."""


def tell(console: Console, results: Sequence[CaseResult]) -> None:
    """A table for each backend and dtype, what has failed, and how many of what there were."""
    groups: dict[tuple[str, str], list[CaseResult]] = {}
    for result in results:
        groups.setdefault((result.backend, result.dtype), []).append(result)
    for (backend, dtype), group in () if console.json_only else groups.items():
        console.say()
        console.table(COLUMNS, [_row(result) for result in group], f"{backend}, {dtype}")
    failed = [result for result in results if result.faults]
    if failed:
        console.say("\nfailed:")
    for result in failed:
        console.say(f"  {result.backend}, {result.dtype}, {result.name}: {result.faults[0]}")
        for fault in result.faults[1:]:
            console.say(f"    {fault}")
    console.say()
    for total in totals(results):
        parts = [f"{total.passed} passed", f"{total.failed} failed"]
        parts += [f"{total.not_claimed} not claimed"] if total.not_claimed else []
        console.say(f"{total.backend}, {total.dtype}: {', '.join(parts)}")


def _row(result: CaseResult) -> list[str]:
    if result.not_claimed:
        return [result.name, *[""] * (len(COLUMNS) - 2), f"not claimed: {result.not_claimed}"]
    same = "" if result.deterministic is None else "yes" if result.deterministic else "no"
    return [
        result.name,
        _number(result.forward),
        _number(result.relative),
        _number(result.worst_gradient),
        "" if isnan(result.forward) else "yes" if result.finite else "no",
        same,
        _verdict(result),
    ]


def _verdict(result: CaseResult) -> str:
    if result.faults:
        return f"FAILED: {_digest(result.faults[0])}"
    if result.refused:
        return f"passed, refused: {_digest(result.refused)}"
    flips = f", {result.flips} flipped" if result.flips else ""
    ill = ", ill-conditioned" if result.note else ""
    return f"passed{flips}{ill}"


def _digest(text: str) -> str:
    return text if len(text) <= DIGEST else f"{text[: DIGEST - 3]}..."


def _number(value: float) -> str:
    return "" if isnan(value) else "0" if value == 0 else f"{value:.1e}"


def document(
    results: Sequence[CaseResult],
    planes: Sequence[PlaneErrors],
    missing: Mapping[str, str],
    picture: str,
) -> dict[str, Any]:
    """For ``json=true``.

    Args:
        results: of all cases.
        planes: errors over planes.
        missing: rasterizers that were left out, and why.
        picture: the heat map's file; empty when there is none.
    """
    return {
        "kind": "stress",
        "cases": [result.document() for result in results],
        "totals": [total.document() for total in totals(results)],
        "planes": [errors.document() for errors in planes],
        "missing": dict(missing),
        "picture": picture,
    }


def list_cases(console: Console, only: Sequence[str]) -> None:
    """Names, and why float32 cannot do better where it cannot.

    Raises:
        ConfigError: a pattern matches no case.
    """
    notes = {case.name: _note(case.refusal, case.conditioning) for case in CASES.values()}
    notes |= {case.name: case.conditioning for case in MOVING_CASES}
    names = chosen(NAMES, only)
    console.table(["case", "note"], [[name, notes[name]] for name in names])
    console.say(f"{len(names)} cases")
    console.result({"cases": [{"name": name, "note": notes[name]} for name in names]})


def _note(refusal: Sequence[str], conditioning: str) -> str:
    return f"must be refused: {', '.join(refusal)}" if refusal else conditioning
