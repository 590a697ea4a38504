"""Finding: one thing about a capture that its user should know, and what all of them come to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from gsfw.core.words import listed


class Weight(Enum):
    """Effect of a finding on training."""

    NOTE = "note"
    """Worth knowing; the capture is not worse for it."""
    LIMIT = "limit"
    """The result will be worse than it could be, somewhere."""
    STOP = "stop"
    """Nothing useful comes of training on it."""


class Verdict(Enum):
    """Conclusion from all findings."""

    GOOD = "good"
    LIMITED = "usable with limits"
    WILL_NOT_TRAIN = "will not train"

    @staticmethod
    def of(findings: Iterable[Finding]) -> Verdict:
        """The verdict of the gravest finding."""
        weights = {finding.weight for finding in findings}
        if Weight.STOP in weights:
            return Verdict.WILL_NOT_TRAIN
        return Verdict.LIMITED if Weight.LIMIT in weights else Verdict.GOOD


@dataclass(frozen=True)
class Finding:
    """A problem, its effect and its remedy: three sentences."""

    kind: str
    """One word or two, the same whatever the numbers are."""
    weight: Weight
    found: str
    why: str
    advice: str
    images: tuple[str, ...] = ()
    """Names of the images it is about, the worst first; empty where it is about all."""

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "kind": self.kind,
            "weight": self.weight.value,
            "found": self.found,
            "why": self.why,
            "advice": self.advice,
            "images": list(self.images),
        }


def sorted_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The gravest first."""
    order = (Weight.STOP, Weight.LIMIT, Weight.NOTE)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.weight)))


def remedies(items: Iterable[tuple[str, str]]) -> list[str]:
    """All remedies, each once and with its purpose where there are several.

    Args:
        items: a file or a reason, and its remedy.
    """
    needs: dict[str, list[str]] = {}
    for item, remedy in items:
        needs.setdefault(remedy, []).append(item)
    if len(needs) < 2:
        return list(needs)
    return [f"{listed(names)}: {remedy}" for remedy, names in needs.items()]
