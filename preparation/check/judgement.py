"""Judgement: every finding of a survey, the gravest first."""

from __future__ import annotations

from gsfw.preparation.check.lens_findings import lens_findings
from gsfw.preparation.check.picture_findings import picture_findings
from gsfw.preparation.check.point_findings import point_findings
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.time_findings import time_findings
from gsfw.preparation.check.viewpoint_findings import viewpoint_findings
from gsfw.preparation.finding import Finding, sorted_findings

JUDGES = (viewpoint_findings, lens_findings, point_findings, picture_findings, time_findings)
"""Each looks at one side of a capture."""


def judge(survey: Survey) -> tuple[Finding, ...]:
    """All findings, the gravest first."""
    return sorted_findings(finding for judge_side in JUDGES for finding in judge_side(survey))
