"""Examination: the measurements of an opened data set, and all findings about it."""

from __future__ import annotations

from dataclasses import dataclass

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
    def of(data: DataManager, config: MethodConfig, images: int | None = None) -> Examination:
        """Measure and judge a data set.

        Args:
            data: the opened data set; the caller closes it.
            config: the settings that it was opened with.
            images: number of images to decode; 0: all; ``None``: the default number.
        """
        survey = Survey.of(data, images)
        return Examination(survey, judge(survey), tuple(data.notes()), config)

    def plan(self, method: str = "") -> Plan:
        """The training that fits the data set; ``method`` is empty to choose one."""
        return Plan.of(self.survey, self.findings, self.config, method)


def judge(survey: Survey) -> tuple[Finding, ...]:
    """All findings, the gravest first."""
    return sorted_findings(finding for judge_side in JUDGES for finding in judge_side(survey))
