"""RequirementsReport: what a completed run required, measured before its callbacks are closed."""

from __future__ import annotations

import logging

from gsfw.commands.interface.console import Console
from gsfw.core.loop.trainer import Trainer
from gsfw.core.progress import stage
from gsfw.studies.requirements.measure import measure
from gsfw.studies.requirements.plot import plot

logger = logging.getLogger("gsfw.run")


class RequirementsReport:
    """Measures once the run is completed, and lets callbacks write it.

    ``line`` is what people are told at the end; empty when nothing was measured.
    """

    def __init__(self, trainer: Trainer, console: Console) -> None:
        self._trainer, self._console = trainer, console
        self.line = ""

    def make(self) -> None:
        """Measure, draw and tell the callbacks; a failure is no failure of the run."""
        trainer = self._trainer
        if trainer.control.stop_reason is not None:  # Somebody wants it to end now.
            return
        try:
            with stage("measuring what the run required"):
                found = measure(trainer.parts, trainer.plan, trainer.step, trainer.info.settings)
                picture = plot(found)
            trainer.callbacks.on_requirements(found, picture)
        except Exception as error:  # The run is finished: all that matters of it is written.
            kind = type(error).__name__
            logger.warning("no report of requirements: %s: %s", kind, error, exc_info=True)
            return
        file = trainer.folder.requirements_plot.name
        self.line = f"requirements: {found.headline}: {file}"
