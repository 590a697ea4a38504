"""CaseResult: what a backend made of one extreme."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isnan, nan
from typing import Any


@dataclass(frozen=True)
class CaseResult:
    """One case, backend and dtype."""

    name: str
    """Of the case."""
    section: str
    backend: str
    """Name of the rasterizer; of a dynamic method, for cases of time."""
    dtype: str
    faults: tuple[str, ...] = ()
    """Why it has failed; empty when it has passed, or makes no claim."""
    not_claimed: str = ""
    """What the case needs and the backend does not claim to have; empty when it was run."""
    forward: float = nan
    """max |C - C_64| of the picture; of models, of positions and opacities. NaN: not drawn."""
    relative: float = nan
    """||C - C_64|| / ||C_64|| of the picture; of models the worst of any row. NaN: not drawn."""
    gradient: Mapping[str, float] = field(default_factory=dict)
    """Relative error in L2 of the gradient of each input, by name; empty: not compared."""
    others: Mapping[str, float] = field(default_factory=dict)
    """The same of further pictures and statistics; empty: not compared."""
    flips: int = 0
    """Pixels of the picture whose list of splats differs by a rounding at a cut-off."""
    finite: bool = True
    deterministic: bool | None = None
    """Same bits again, also with another number of threads; ``None``: not repeated."""
    refused: str = ""
    """The message with which it was refused; empty: it was not."""
    note: str = ""
    """What else is to be known, such as why float32 cannot do better."""

    @property
    def passed(self) -> bool:
        """Whether it is as it should be; what is not claimed has not passed."""
        return not self.faults and not self.not_claimed

    @property
    def worst_gradient(self) -> float:
        """The largest error of a gradient; NaN where there is none."""
        errors = list(self.gradient.values())
        return nan if not errors or any(map(isnan, errors)) else max(errors)

    def document(self) -> dict[str, Any]:
        """For ``json=true``."""
        return {
            "name": self.name,
            "section": self.section,
            "backend": self.backend,
            "dtype": self.dtype,
            "passed": self.passed,
            "claimed": not self.not_claimed,
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
    """Cases of one backend and dtype, counted."""

    backend: str
    dtype: str
    passed: int
    failed: int
    not_claimed: int

    def document(self) -> dict[str, Any]:
        """For ``json=true``."""
        return {
            "backend": self.backend,
            "dtype": self.dtype,
            "passed": self.passed,
            "failed": self.failed,
            "not_claimed": self.not_claimed,
        }


def totals(results: Iterable[CaseResult]) -> list[Totals]:
    """Those of every backend and dtype, in the order in which they first come."""
    groups: dict[tuple[str, str], list[CaseResult]] = {}
    for result in results:
        groups.setdefault((result.backend, result.dtype), []).append(result)
    return [
        Totals(
            backend,
            dtype,
            passed=sum(result.passed for result in group),
            failed=sum(bool(result.faults) for result in group),
            not_claimed=sum(bool(result.not_claimed) for result in group),
        )
        for (backend, dtype), group in groups.items()
    ]
