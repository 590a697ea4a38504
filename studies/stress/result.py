"""CaseResult: the outcome of one case, counts of outcomes, and both as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isnan, nan
from typing import Any

from gsfw.studies.table import Table

COLUMNS = ("case", "forward", "relative", "gradient", "finite", "same bits", "verdict")

DIGEST = 46
"""Characters of a message in a table; the document has all of it."""


@dataclass(frozen=True)
class CaseResult:
    """Outcome of one case for one backend and dtype."""

    name: str
    """Name of the case."""
    section: str
    backend: str
    """Name of the rasterizer; for cases of time, of the dynamic method."""
    dtype: str
    faults: tuple[str, ...] = ()
    """Reasons of a failure; empty when the case has passed or was not run."""
    not_claimed: str = ""
    """Needs of the case that the backend does not claim to meet; empty when the case was run."""
    left_out: tuple[str, ...] = ()
    """Features that the backend does not claim, and that were left out of the case."""
    forward: float = nan
    """max |C - C_64| of the image; of models, of positions and opacities. NaN: no image."""
    relative: float = nan
    """||C - C_64|| / ||C_64|| of the image; of models the worst of any row. NaN: no image."""
    gradient: Mapping[str, float] = field(default_factory=dict)
    """Relative error in L2 of the gradient of each input, by name; empty: not compared."""
    others: Mapping[str, float] = field(default_factory=dict)
    """Relative error in L2 of further images and statistics, by name; empty: not compared."""
    flips: int = 0
    """Pixels of the image whose list of splats differs by a rounding at a cut-off."""
    finite: bool = True
    deterministic: bool | None = None
    """Equal bits when repeated, also with another number of threads; ``None``: not repeated."""
    refused: str = ""
    """Message of the refusal; empty: the case was not refused."""
    note: str = ""
    """A remark, for example why float32 cannot do better."""

    @property
    def passed(self) -> bool:
        """True if the outcome is the expected one; a case that was not run has not passed."""
        return not self.faults and not self.not_claimed

    @property
    def worst_gradient(self) -> float:
        """The largest error of a gradient; NaN where there is none."""
        errors = list(self.gradient.values())
        return nan if not errors or any(map(isnan, errors)) else max(errors)

    def document(self) -> dict[str, Any]:
        """Plain data for ``json=true``."""
        return {
            "name": self.name,
            "section": self.section,
            "backend": self.backend,
            "dtype": self.dtype,
            "passed": self.passed,
            "claimed": not self.not_claimed,
            "left_out": list(self.left_out),
            "forward": self.forward,
            "relative": self.relative,
            "gradient": dict(self.gradient),
            "others": dict(self.others),
            "flips": self.flips,
            "finite": self.finite,
            "deterministic": self.deterministic,
            "refused": self.refused,
            "note": "; ".join(text for text in (*self.faults, self.not_claimed, self.note) if text),
        }


@dataclass(frozen=True)
class Totals:
    """Numbers of cases of one backend and dtype."""

    backend: str
    dtype: str
    passed: int
    failed: int
    not_claimed: int
    left_out: tuple[str, ...] = ()
    """Features that were left out of cases, since the backend does not claim them."""

    def document(self) -> dict[str, Any]:
        """Plain data for ``json=true``."""
        return asdict(self)

    def __str__(self) -> str:
        """A line for people."""
        parts = [f"{self.passed} passed", f"{self.failed} failed"]
        parts += [f"{self.not_claimed} not claimed"] if self.not_claimed else []
        without = f" (judged without {', '.join(self.left_out)})" if self.left_out else ""
        return f"{self.backend}, {self.dtype}: {', '.join(parts)}{without}"


Groups = Mapping[tuple[str, str], Sequence[CaseResult]]
"""Results by backend and dtype."""


def grouped(results: Iterable[CaseResult]) -> Groups:
    """Results by backend and dtype, in their order."""
    groups: dict[tuple[str, str], list[CaseResult]] = {}
    for result in results:
        groups.setdefault((result.backend, result.dtype), []).append(result)
    return groups


def totals(results: Iterable[CaseResult]) -> list[Totals]:
    """Numbers of cases of every backend and dtype."""
    return [
        Totals(
            backend,
            dtype,
            passed=sum(result.passed for result in group),
            failed=sum(bool(result.faults) for result in group),
            not_claimed=sum(bool(result.not_claimed) for result in group),
            left_out=tuple(sorted({word for result in group for word in result.left_out})),
        )
        for (backend, dtype), group in grouped(results).items()
    ]


def tables(results: Iterable[CaseResult]) -> list[Table]:
    """A table of cases for each backend and dtype."""
    return [
        Table(COLUMNS, [_row(result) for result in group], f"{backend}, {dtype}")
        for (backend, dtype), group in grouped(results).items()
    ]


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
