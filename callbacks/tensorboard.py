"""TensorBoard: curves, images and settings as event files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
import yaml
from jaxtyping import UInt8
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport
from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.requirements import Requirements
from gsfw.core.loop.run_folder import RunFolder

ERROR_GAIN = 4.0
"""Factor of absolute errors, for visibility."""


class TensorBoard(Callback):
    """train/*, eval/*, baseline/*, gaussians/count, lr/*, time/*, mem/*; findings/* as text.

    Images are gt | render | error. At the end requirements/*: the floats of the final model, and
    the PSNR gain of each group.
    """

    def __init__(self, images: int) -> None:
        """Store the number of displayed held-out views per evaluation."""
        self._images = images
        self._writer: SummaryWriter | None = None
        self._run: RunInfo | None = None
        self._shown: set[str] = set()

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the events; steps of an interrupted run after its checkpoint are purged."""
        self._run = run
        path = RunFolder(run.folder).tensorboard
        purge = run.first_step + 1 if run.first_step else None
        with readable_write_errors(path):
            self._writer = SummaryWriter(str(path), purge_step=purge)
        text = yaml.safe_dump(dict(run.settings), sort_keys=False)
        indented = "".join(f"    {line}\n" for line in text.splitlines())
        self._writer.add_text("config", indented, run.first_step)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Write the curves of a logged step."""
        scalars = {
            "train/loss": report.loss,
            "train/psnr": report.psnr,
            "train/skipped_steps": report.skipped_steps,
            "train/resolution": report.resolution,
            "gaussians/count": report.num_gaussians,
            **{f"gaussians/{verb}": count for verb, count in report.refined.items()},
            "time/step_ms": report.step_ms,
            **{f"train/{name}": value for name, value in report.losses.items()},
            **{f"lr/{name}": value for name, value in report.learning_rates.items()},
            **{f"time/{name}_ms": value for name, value in report.stage_ms.items()},
            **{f"mem/{name}_mb": value for name, value in report.memory_mb.items()},
        }
        self._add(report.step, scalars)

    def _add(self, step: int, scalars: Mapping[str, float]) -> None:
        assert self._writer is not None
        assert self._run is not None
        with readable_write_errors(self._run.folder):
            for tag, value in scalars.items():
                self._writer.add_scalar(tag, value, step)

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """Write the images of the first few held-out views, the same ones in each evaluation."""
        assert self._writer is not None
        if len(self._shown) < self._images:
            self._shown.add(view.name)
        if view.name not in self._shown:
            return
        rendered, target = view.rendered.clamp(0, 1), view.target.clamp(0, 1)
        error = ((rendered - target).abs() * ERROR_GAIN).clamp(0, 1)
        row = torch.cat([target, rendered, error], dim=1)
        images = {f"eval/{view.name}": row}
        images |= {f"eval/{view.name}/{name}": image for name, image in view.images.items()}
        for tag, image in images.items():
            self._writer.add_image(tag, image.clamp(0, 1).cpu(), step, dataformats="HWC")

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Write the curves of the means."""
        assert self._writer is not None
        self._add(step, {f"eval/{name}": value for name, value in evaluation.means.items()})
        if evaluation.training_psnr is not None:
            self._add(step, {"eval/training_psnr": evaluation.training_psnr})
        baselines = {k: v for k, v in evaluation.baselines.items() if isinstance(v, float)}
        self._add(step, {f"baseline/{name}": value for name, value in baselines.items()})
        for finding in evaluation.findings or ():
            self._writer.add_text(f"findings/{finding.key}", finding.message, step)
        self._writer.flush()

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Write settings and final figures, for the hparams page."""
        assert self._writer is not None
        assert self._run is not None
        if summary["completed"]:
            plain = (bool, int, float, str)
            settings = {
                key: value if isinstance(value, plain) else str(value)
                for key, value in self._run.settings.items()
            }
            figures = {
                f"hparam/{key}": float(value)
                for key, value in summary.items()
                if isinstance(value, int | float) and not isinstance(value, bool)
            }
            # SummaryWriter.add_hparams would open a second run beside this one.
            for event in hparams(settings, figures):
                self._writer._get_file_writer().add_summary(event)
            self._add(step, figures)

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Write floats and dB of every group, and the plot as an image."""
        assert self._writer is not None
        scalars = {
            "requirements/sh_floats": float(requirements.sh_floats),
            "requirements/sh_floats_full": float(requirements.sh_floats_full),
            "requirements/total_floats": float(requirements.total_floats),
        }
        for group in requirements.groups:
            name = group.name.replace(" ", "_")
            scalars[f"requirements/floats/{name}"] = float(group.floats)
            if group.bought_db is not None:
                scalars[f"requirements/bought_db/{name}"] = group.bought_db
        self._add(requirements.step, scalars)
        self._writer.add_text("requirements", requirements.headline, requirements.step)
        self._writer.add_image("requirements", plot, requirements.step, dataformats="HWC")

    def close(self) -> None:
        """Flush and close the events."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
