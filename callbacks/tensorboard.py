"""TensorBoard: curves, images, histograms, settings and findings of a run as event files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8
from tensorboard.compat.proto.summary_pb2 import Summary
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from gsfw.callbacks.board_curves import (
    LAYOUT,
    evaluation_curves,
    hparam_metrics,
    of_a_step,
    requirement_curves,
    result_curves,
    step_curves,
)
from gsfw.callbacks.board_hparams import hparam_events
from gsfw.callbacks.board_images import captioned, comparison, distractors, summary_of
from gsfw.callbacks.board_pages import findings_page, run_page, settings_page
from gsfw.callbacks.event_files import cut_events, told_once
from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport
from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.loop.countdown import Countdown
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.requirements import Requirements
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.splats import Sh, Splats

IMAGES_OF_A_RUN = 10
"""Evaluations with images in a run, about; each costs megabytes."""
PAGES = ("1_run", "2_settings")
"""Texts at the start of a run, and of each part of a resumed one."""
VIEWS, DISTRACTORS, REQUIREMENTS = "2_views", "3_distractors", "9_requirements/chart"
"""Tags of images: views come before the chart."""
WRITTEN_ANEW = ("_hparams_/", "custom_scalars__config__")
"""Tags without a step that each part of a run writes."""
BINS: dict[str, tuple[int, tuple[float, float] | None]] = {
    "opacity": (40, (0.0, 1.0)),
    "log10_scale": (60, None),
    "sh_degree": (5, (-0.5, 4.5)),
}
"""Number and range of the bins of each histogram; ``None``: from the least to the largest value."""
FAINTEST = 1e-12
"""Scales are at least this, in scene units, for their logarithm."""


class TensorBoard(Callback):
    """Curves (``board_curves``), images, histograms, settings, findings and hparams."""

    def __init__(self, images: int) -> None:
        """Store the number of displayed held-out views per evaluation."""
        self._images = images
        self._stack = ExitStack()
        self._writer: SummaryWriter | None = None
        self._run: RunInfo | None = None
        self._countdown: Countdown | None = None
        self._model: ModelHandle | None = None
        self._shown: set[str] = set()
        self._last_images = self._last_distractors = 0
        self._findings: str | None = None

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the events; those of an interrupted run after its checkpoint are removed."""
        self._run, self._countdown = run, Countdown(run)
        self._last_images = self._last_distractors = run.first_step
        path = RunFolder(run.folder).tensorboard
        self._stack.enter_context(told_once())
        with readable_write_errors(path):
            cut_events(path, partial(_stays, run))
            self._writer = SummaryWriter(str(path))
            self._writer.add_custom_scalars(LAYOUT)
            for name, text in zip(PAGES, (run_page(run), settings_page(run.settings)), strict=True):
                self._writer.add_text(name, text, run.first_step)
            self._writer.flush()

    def on_tick(self, step: int, control: Control) -> None:
        """Note the time, for the remaining one."""
        assert self._countdown is not None
        self._countdown.tick()

    def on_step(self, report: StepReport, control: Control) -> None:
        """Write the curves of a logged step."""
        assert self._countdown is not None
        self._countdown.report(report)
        self._model = report.model
        self._add(report.step, step_curves(report, self._countdown.seconds()))
        self._add_distractors(report)

    def _add_distractors(self, report: StepReport) -> None:
        """Write the distractors of a training image, about ten times in a run."""
        assert self._run is not None
        view, step, steps = report.view, report.step, self._run.steps
        if view is None or view.left_out is None or self._images == 0:
            return
        if step - self._last_distractors >= steps // IMAGES_OF_A_RUN:
            self._last_distractors = step
            self._add_image(f"{DISTRACTORS}/{view.name}", distractors(view, step, steps), step)

    def _add(self, step: int, scalars: Mapping[str, float]) -> None:
        """Write scalars as one event: an event for each took most of the time of a report."""
        values = [
            Summary.Value(tag=tag, simple_value=float(value)) for tag, value in scalars.items()
        ]
        with self._writing() as writer:
            writer._get_file_writer().add_summary(Summary(value=values), step)

    def _add_image(self, tag: str, image: UInt8[np.ndarray, "h w 3"], step: int) -> None:
        with self._writing() as writer:
            writer._get_file_writer().add_summary(summary_of(tag, image), step)
            # TensorBoard's thread computes the image's checksum in Python, under whose lock each
            # operation of torch would wait: steps and renders would take several times as long.
            writer.flush()

    @contextmanager
    def _writing(self) -> Iterator[SummaryWriter]:
        """The writer; errors of the disk, which it passes on from its thread, in one sentence."""
        assert self._writer is not None
        assert self._run is not None
        with readable_write_errors(self._run.folder):
            yield self._writer

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """Write the images of a few held-out views, the same ones about ten times in a run."""
        assert self._run is not None
        if not self._images_due(step, self._run.steps):
            return
        if len(self._shown) < self._images:
            self._shown.add(view.name)
        if view.name not in self._shown:
            return
        self._add_image(f"{VIEWS}/{view.name}", comparison(view, step, self._run.steps), step)
        for name, image in view.images.items():
            caption = f"{name}, step {step:,} of {self._run.steps:,}"
            self._add_image(
                f"{VIEWS}/{view.name}/{name}", captioned([image], ("",), view.name, caption), step
            )

    def _images_due(self, step: int, steps: int) -> bool:
        """True if an evaluation has images: the last one, and those a tenth of the run apart."""
        return step >= steps or step - self._last_images >= steps // IMAGES_OF_A_RUN

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Write the curves of the means, histograms of the model, and what is not sound."""
        assert self._run is not None
        assert self._countdown is not None
        self._countdown.evaluated(step, len(evaluation.views))
        if self._images_due(step, self._run.steps):
            self._last_images = step
        self._add(step, evaluation_curves(evaluation))
        with self._writing() as writer:
            if self._model is not None:
                _add_histograms(writer, step, self._model.splats())
            if evaluation.findings is not None:
                keys = " ".join(finding.key for finding in evaluation.findings)
                if keys != self._findings:  # Said again only when it changes.
                    writer.add_text("3_findings", findings_page(step, evaluation.findings), step)
                self._findings = keys
            writer.flush()

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Write settings and final figures, for the hparams page."""
        assert self._run is not None
        if not summary["completed"]:
            return
        settings = {
            key: value
            for key, value in self._run.settings.items()
            if not key.startswith("callbacks.")
        }
        with self._writing() as writer:
            for event in hparam_events(settings, self._run.scene, hparam_metrics(summary)):
                writer._get_file_writer().add_summary(event)
        self._add(step, result_curves(summary))

    def on_requirements(self, requirements: Requirements, plot: UInt8[Tensor, "h w 3"]) -> None:
        """Write floats and dB of every group, and the plot as an image."""
        self._add(requirements.step, requirement_curves(requirements))
        with self._writing() as writer:
            writer.add_text("4_requirements", requirements.headline, requirements.step)
        self._add_image(REQUIREMENTS, plot.numpy(), requirements.step)

    def close(self) -> None:
        """Flush and close the events."""
        with self._stack:
            if self._writer is not None:
                self._stack.callback(self._writer.close)
                self._writer = None


def _add_histograms(writer: SummaryWriter, step: int, splats: Splats) -> None:
    """Write opacity, largest scale and SH degree; those of a moving scene at its first time."""
    for name, values in _distributions(splats).items():
        if not len(values):
            continue
        number, bounds = BINS[name]
        counts, edges = np.histogram(values, number, bounds)
        writer.add_histogram_raw(
            f"gaussians/{name}",
            min=float(values.min()),
            max=float(values.max()),
            num=len(values),
            sum=float(values.sum(dtype=np.float64)),
            sum_squares=float(np.square(values, dtype=np.float64).sum()),
            bucket_limits=edges[1:].tolist(),
            bucket_counts=counts.tolist(),
            global_step=step,
        )


def _stays(run: RunInfo, step: int, tag: str) -> bool:
    """True if a resumed run does not write this event again."""
    if not run.first_step or step > run.first_step or tag.startswith(WRITTEN_ANEW):
        return False
    is_again = step == run.first_step and (
        tag.startswith(PAGES) or (step >= run.steps and not of_a_step(tag))
    )
    return not is_again


def _distributions(splats: Splats) -> dict[str, np.ndarray]:
    """Values of each Gaussian, by name: opacity, log10 of the largest scale, SH degree."""
    found: dict[str, Tensor] = {"opacity": splats.opacities}
    if splats.scales is not None:
        found["log10_scale"] = splats.scales.amax(-1).clamp_min(FAINTEST).log10()
    if isinstance(splats.colors, Sh):
        found["sh_degree"] = _degrees(splats.colors)
    finite = {name: values[values.isfinite()] for name, values in found.items()}
    return {name: values.float().cpu().numpy() for name, values in finite.items()}


def _degrees(colors: Sh) -> Tensor:
    """SH degree of each Gaussian that is in use: at most the active one."""
    if colors.offsets is not None:
        degrees = (colors.offsets.diff() + 1).sqrt().round() - 1
    else:
        full = round(colors.width**0.5) - 1
        degrees = torch.full((len(colors.coefficients),), float(full))
    return degrees.clamp_max(colors.degree)
