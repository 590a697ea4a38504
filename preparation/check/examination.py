"""Examination: the measurements of an opened data set, and all findings about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain

from gsfw.core.config import MethodConfig
from gsfw.core.datamanager import DataManager
from gsfw.preparation.check.camera_findings import camera_findings
from gsfw.preparation.check.image_findings import image_findings
from gsfw.preparation.check.plan import Plan
from gsfw.preparation.check.point_findings import point_findings
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.time_findings import time_findings
from gsfw.preparation.finding import Finding, sorted_findings

JUDGES = (camera_findings, point_findings, image_findings, time_findings)
"""Each judges one side of a capture."""


@dataclass(frozen=True)
class Examination:
    """A survey of a data set and its findings."""

    survey: Survey
    findings: tuple[Finding, ...]
    """The gravest first."""
    notes: tuple[str, ...]
    """Notes of the data manager on how it read the data set."""
    config: MethodConfig
    """The settings that the data set was opened with."""

    @staticmethod
    def of(
        data: DataManager,
        config: MethodConfig,
        images: int | None = None,
        tell: Callable[[Finding], None] | None = None,
        known: tuple[Finding, ...] = (),
    ) -> Examination:
        """Measure and judge a data set.

        Args:
            data: the opened data set; the caller closes it.
            config: the settings that it was opened with.
            images: number of images to decode; 0: all; ``None``: the default number.
            tell: receives each finding as soon as it is found.
            known: findings that were made before, which come first.
        """
        survey = Survey(data, images)
        findings = judge(survey, tell, known)
        survey.measure()
        return Examination(survey, findings, tuple(data.notes()), config)

    def plan(self, method: str = "") -> Plan:
        """The training that fits the data set; ``method`` is empty to choose one."""
        return Plan.of(self.survey, self.findings, self.config, method)


def judge(
    survey: Survey,
    tell: Callable[[Finding], None] | None = None,
    known: tuple[Finding, ...] = (),
) -> tuple[Finding, ...]:
    """All findings, the gravest first; ``tell`` receives each as soon as it is found."""
    findings: list[Finding] = []
    for finding in chain(known, *(judge_side(survey) for judge_side in JUDGES)):
        findings.append(finding)
        if tell is not None:
            tell(finding)
    return sorted_findings(findings)
