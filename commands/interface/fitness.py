"""Fitness: whether a data set and a method fit; what `gsfw check` and `--dry-run` both say."""

from __future__ import annotations

from gsfw.core.datamanager import DataManager
from gsfw.core.errors import UserError
from gsfw.plugins.compose import check
from gsfw.plugins.data_fit import check_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Settings
from gsfw.preparation.check.camera_findings import camera_findings
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight


def misfits(settings: Settings, registry: Registry, data: DataManager) -> tuple[Finding, ...]:
    """The refusal of a run with these settings before its first step; nothing if it starts."""
    try:
        check(settings, registry)
        check_data(settings, registry, data, settings.config.build())
    except UserError as error:
        return (
            Finding(
                f"not for method {settings.method.name}",
                Weight.STOP,
                error.message,
                "Training ends with this error.",
                error.advice or "gsfw check without method=NAME suggests one.",
            ),
        )
    return ()


def hopeless(data: DataManager) -> tuple[Finding, ...]:
    """Findings of `gsfw check` with cameras that show no shape, whatever the method."""
    found = camera_findings(Survey(data))
    return tuple(finding for finding in found if finding.weight is Weight.STOP)
