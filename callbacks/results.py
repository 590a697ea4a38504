"""Results: figures as JSON, for programs and plots."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import IO, Any

from jaxtyping import UInt8
from PIL import Image
from torch import Tensor

from gsfw.charts.time_plot import write_time_plot
from gsfw.core.callback import Callback, Control, RunInfo, StepReport
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.requirements import Requirements
from gsfw.core.loop.run_folder import RunFolder


class Results(Callback):
    """Writes metrics.jsonl (a line per logged step), eval/step_N.json, and at last metrics.json.

    The requirements of a completed run are in requirements.json and requirements.png.
    """

    def __init__(self) -> None:
        self._folder: RunFolder | None = None
        self._run: RunInfo | None = None
        self._log: IO[str] | None = None

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the log; a resumed run continues at its checkpoint."""
        self._run, self._folder = run, RunFolder(run.folder)
        self._folder.cut_metrics_log(run.first_step, run.first_step == run.steps)
        with readable_write_errors(self._folder.metrics_log):
            self._log = self._folder.metrics_log.open("a", encoding="utf-8")

    def _write(self, document: Mapping[str, Any]) -> None:
        assert self._log is not None
        assert self._folder is not None
        with readable_write_errors(self._folder.metrics_log):
            self._log.write(json_text(document) + "\n")
            self._log.flush()

    def on_step(self, report: StepReport, control: Control) -> None:
        """Write one line per logged step."""
        self._write(
            {
                "step": report.step,
                "loss": report.loss,
                **{f"loss/{name}": value for name, value in report.losses.items()},
                **{f"method/{name}": value for name, value in report.metrics.items()},
                "psnr": report.psnr,
                "resolution": report.resolution,
                "num_gaussians": report.num_gaussians,
                **{f"refined/{verb}": count for verb, count in report.refined.items()},
                **{f"lr/{name}": value for name, value in report.learning_rates.items()},
                "step_ms": report.step_ms,
                "skipped_steps": report.skipped_steps,
            }
        )

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Write the figures of every held-out view."""
        assert self._run is not None
        assert self._folder is not None
        means = {f"eval/{name}": value for name, value in evaluation.means.items()}
        self._write({"step": step, **means})
        path = self._folder.evaluations / f"step_{step:09d}.json"
        protocol = dict(self._run.protocol)
        if step < self._run.steps:
            protocol["checkpoint"] = f"after step {step} of {self._run.steps}"
        if len(evaluation.views) < evaluation.held_out:
            protocol["views"] = len(evaluation.views)
            protocol["sample"] = f"{evaluation.count} held-out views, evenly spread"
        self._folder.write_json(path, {"step": step, **evaluation.document(), "protocol": protocol})
        write_time_plot(path, evaluation)

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Write the final figures of a completed run."""
        assert self._run is not None
        assert self._folder is not None
        if summary["completed"]:
            head = {"method": self._run.method, "scene": self._run.scene}
            document = {**head, **summary, "protocol": dict(self._run.protocol)}
            self._folder.write_json(self._folder.summary, document)

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Write the requirements as figures and as an image."""
        assert self._folder is not None
        self._folder.write_json(self._folder.requirements, requirements.document())
        buffer = io.BytesIO()
        Image.fromarray(plot.numpy()).save(buffer, "PNG")
        write_atomically(self._folder.requirements_plot, buffer.getvalue())

    def close(self) -> None:
        """Close the log."""
        if self._log is not None:
            self._log.close()
            self._log = None
