"""Judgement: every finding of a survey, the gravest first."""

from __future__ import annotations

from gsfw.commands.capture_check.lens_findings import lens_findings
from gsfw.commands.capture_check.picture_findings import picture_findings
from gsfw.commands.capture_check.point_findings import point_findings
from gsfw.commands.capture_check.survey import Survey
from gsfw.commands.capture_check.time_findings import time_findings
from gsfw.commands.capture_check.viewpoint_findings import viewpoint_findings
from gsfw.core.finding import Finding, sorted_findings

JUDGES = (viewpoint_findings, lens_findings, point_findings, picture_findings, time_findings)
"""Each looks at one side of a capture."""


def judge(survey: Survey) -> tuple[Finding, ...]:
    """All findings, the gravest first."""
    return sorted_findings(finding for judge_side in JUDGES for finding in judge_side(survey))
