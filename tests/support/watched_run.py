"""A short run as its callbacks see it: what they are told, without a training."""

import math

import torch

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.requirements import FloatGroup, Requirements

SUMMARY = {
    "completed": True, "psnr": 30.5, "ssim": 0.9, "num_gaussians": 100, "train_seconds": 1.0,
    "steps": 20, "peak_memory_mb": 100.0, "views": 5, "model_bytes": 23_600,
}  # fmt: skip
"""The figures at the end of a completed run."""


def run_info(path, first_step: int = 0, steps: int = 20, **settings) -> RunInfo:
    """What is known of a run at its start."""
    settings = {"method": "3dgs", "steps": steps, "holdout": [], **settings}
    protocol = {"background": [1.0, 1.0, 1.0]}
    return RunInfo(path, "3dgs", "toy", steps, first_step, settings, protocol, ("a note",))


def report_of(step: int, resolution: float = 1.0, step_ms: float = 10.0, model=None) -> StepReport:
    """The figures of a logged step."""
    return StepReport(
        step=step, loss=0.5 / step, losses={"l1": 0.4 / step}, psnr=20.0 + step,
        num_gaussians=100, learning_rates={"means": 1e-4}, step_ms=step_ms,
        stage_ms={"render": step_ms / 2}, memory_mb={"rss": 200.0}, resolution=resolution,
        refined={"cloned": 3}, metrics={"share": 0.25}, model=model,
    )  # fmt: skip


def view(index: int) -> EvaluatedView:
    """A grey held-out image, rendered as it is; the first one has a depth image too."""
    image = torch.full((8, 10, 3), 0.5)
    own = {"depth": image} if index == 0 else {}
    return EvaluatedView(f"v{index}", {"psnr": 30.0}, image, image, own)


def evaluation(psnr: float = 30.0, **more) -> Evaluation:
    """Figures of one held-out view."""
    return Evaluation(("v0",), ({"psnr": psnr},), 1.0, {"psnr": psnr}, **more)


def play(callback: Callback, path, steps=(10, 20), first_step: int = 0, summary=None) -> None:
    """A short run as the trainer tells it, with one evaluation, after its last step."""
    control, last = Control(), max((first_step, *steps))
    callback.on_start(run_info(path, first_step), control)
    for step in steps:
        callback.on_tick(step, control)
        callback.on_step(report_of(step), control)
    for index in range(6):
        callback.on_view(last, view(index))
    callback.on_evaluation(last, evaluation(), control)
    callback.on_checkpoint(last, path / "step.pt")
    callback.on_end(last, SUMMARY if summary is None else summary)
    callback.close()
    assert control.stop_reason is None


REQUIREMENTS = Requirements(
    headline="48 floats each for colour", step=20, num_gaussians=2,
    groups=(FloatGroup("positions", 6, None, ""), FloatGroup("SH band 1", 18, 0.25, "so")),
    sh_floats=18, sh_floats_full=24, rows_by_degree=(0, 2), training_floats={"optimizer": 48},
    views=("v0",), split="eval", protocol="", psnr=30.0, strategy={"why": math.nan},
)  # fmt: skip
PLOT = torch.full((4, 5, 3), 200, dtype=torch.uint8)


def told_requirements(callback: Callback, path) -> None:
    """What the trainer tells a callback at the end of a run."""
    callback.on_start(run_info(path), Control())
    callback.on_end(20, SUMMARY)
    callback.on_requirements(REQUIREMENTS, PLOT)
    callback.close()
