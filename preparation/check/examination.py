"""Examination: a data set opened as training would, looked at, and judged."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.plugins.compose import open_data
from gsfw.plugins.settings import Settings
from gsfw.preparation.check.judgement import judge
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding


@dataclass(frozen=True)
class Examination:
    """What is known of a data set that can be opened."""

    survey: Survey
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    """How it was read."""

    @staticmethod
    def of(settings: Settings, pictures: int | None) -> Examination:
        """Examine the data set of a run's settings.

        Args:
            settings: of the training.
            pictures: how many are decoded; 0: all; ``None``: the usual number.

        Raises:
            DataError: it cannot be opened.
        """
        data = open_data(settings)
        try:
            survey = Survey.of(data, pictures)
            notes = tuple(data.notes())
        finally:
            data.close()
        return Examination(survey, judge(survey), notes)
