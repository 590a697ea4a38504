"""RequirementsReport: the requirements of a completed run, measured before its callbacks close."""

from __future__ import annotations

import logging

from gsfw.core.errors import OutputError
from gsfw.core.loop.trainer import Trainer
from gsfw.core.progress import stage
from gsfw.studies.requirements.measure import measure
from gsfw.studies.requirements.plot import plot

logger = logging.getLogger("gsfw.run")


class RequirementsReport:
    """Measures a completed run and hands the result to the callbacks.

    ``headline`` is a phrase for the end of the run; empty when nothing was measured.
    """

    def __init__(self, trainer: Trainer) -> None:
        self._trainer = trainer
        self.headline = ""

    def make(self) -> None:
        """Measure, plot and notify the callbacks; a failure of these does not fail the run.

        Raises:
            OutputError: the files cannot be written; gsfw resume writes them.
        """
        trainer = self._trainer
        if trainer.control.stop_reason is not None:  # Somebody wants it to end now.
            return
        try:
            with stage("measuring what the run required"):
                found = measure(trainer.parts, trainer.plan, trainer.step, trainer.info.settings)
                image = plot(found)
            trainer.callbacks.on_requirements(found, image)
        except OutputError:
            raise
        except Exception as error:  # The run is finished: all that matters of it is written.
            kind = type(error).__name__
            logger.warning("no report of requirements: %s: %s", kind, error, exc_info=True)
            return
        self.headline = found.headline
