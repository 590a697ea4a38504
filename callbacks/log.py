"""Log: the events of a run in log.txt, line by line."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from jaxtyping import UInt8
from torch import Tensor

from gsfw.core.callback import Callback, Control, RunInfo, StepReport
from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.requirements import Requirements
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shown_metrics

logger = logging.getLogger("gsfw.run")


class _LogFile(logging.FileHandler):
    """A file whose lines may be lost: the disk of a run may be full, which the run itself tells."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Show no traceback for a line that cannot be written."""

    def close(self) -> None:
        """Close the file, even if its last line cannot be written."""
        with suppress(OSError):
            super().close()


class Log(Callback):
    """Writes log.txt; includes the log records of all parts of gsfw."""

    def __init__(self, every: int) -> None:
        """Write a line for every n-th logged step: people read the log."""
        self._every = every
        self._handler: logging.Handler | None = None
        self._level = logging.NOTSET
        self._protocol: Mapping[str, Any] = {}
        self._reports = 0

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the file; log the method and the scene."""
        self._protocol = run.protocol
        path = RunFolder(run.folder).log
        with readable_write_errors(path):
            self._handler = _LogFile(path, encoding="utf-8")
        self._handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        root = logging.getLogger("gsfw")
        self._level = root.level
        root.setLevel(logging.INFO)
        root.addHandler(self._handler)
        verb = "resumed at step" if run.first_step else "started at step"
        logger.info("%s on %s %s %d of %d", run.method, run.scene, verb, run.first_step, run.steps)
        for note in run.notes:
            logger.info("note: %s", note)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Log a line every n-th step."""
        if self._reports % self._every == 0:
            logger.info(
                "step %d: loss %.5f, psnr %.2f dB, %d Gaussians, %.1f ms/step, %d steps skipped",
                report.step,
                report.loss,
                report.psnr,
                report.num_gaussians,
                report.step_ms,
                report.skipped_steps,
            )
        self._reports += 1

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Log the means."""
        names = shown_metrics(evaluation.means, self._protocol)
        means = ", ".join(f"{name} {evaluation.means[name]:.4f}" for name in names)
        count = f"{evaluation.count} " if means else ""
        logger.info("step %d: %sheld-out views: %s", step, count, means or "there are none")

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Log the name of the checkpoint."""
        logger.info("step %d: checkpoint %s", step, path.name)

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Log the summary's single figures; its lists and groups are in metrics.json."""
        short = {key: v for key, v in summary.items() if not isinstance(v, list | Mapping)}
        logger.info("ended at step %d: %s", step, short)

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Log the headline."""
        logger.info("requirements: %s", requirements.headline)

    def close(self) -> None:
        """Close the file."""
        if self._handler is not None:
            root = logging.getLogger("gsfw")
            root.removeHandler(self._handler)
            root.setLevel(self._level)
            self._handler.close()
            self._handler = None
