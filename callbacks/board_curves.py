"""Curves of TensorBoard: tags in groups, so that the first group says whether a run works.

TensorBoard sorts groups, and tags within a group, by name: the numbers of the groups are their
order, and the names of the first group put loss and PSNR before time and count. Every figure has
one tag.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsfw.core.callback import StepReport
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.requirements import Requirements

OVERVIEW = "1_overview"
QUALITY = "2_quality"
GAUSSIANS = "3_gaussians"
LOSSES = "4_loss_terms"
METHOD = "4_method"
TIME = "5_time"
MEMORY = "6_memory"
RATES = "7_learning_rates"
RESULT = "8_result"
REQUIREMENTS = "9_requirements"

HELD_OUT_PSNR = f"{OVERVIEW}/psnr_held_out"
COUNT = f"{OVERVIEW}/total_gaussians"

STEP_TAGS = (
    *(f"{OVERVIEW}/{name}" for name in ("loss", "psnr_training", "step_ms", "time_left_minutes")),
    *(COUNT, f"{QUALITY}/skipped_steps", f"{QUALITY}/image_size"),
)
"""Tags of a logged step in groups that have others too."""
BASELINE_TAGS = {"constant_psnr": f"{OVERVIEW}/psnr_of_one_color"}
"""Tags of images without a model; the others are in the second group."""

RESULTS = ("train_seconds", "model_bytes", "peak_memory_mb", "peak_gpu_memory_mb", "render_ms")
"""Figures that a run has only at its end."""

LAYOUT = {
    "Quality": {
        "PSNR in dB: training image, held-out images, one colour": [
            "Multiline",
            [rf"^{OVERVIEW}/psnr_"],
        ],
        "loss": ["Multiline", [rf"^{OVERVIEW}/loss$"]],
        "Gaussians": ["Multiline", [rf"^{COUNT}$"]],
        "minutes left": ["Multiline", [rf"^{OVERVIEW}/time_left_minutes$"]],
    },
    "Loss and growth": {
        "terms of the loss, weighted": ["Multiline", [rf"^{LOSSES}/"]],
        "Gaussians added and removed since the last point": ["Multiline", [rf"^{GAUSSIANS}/"]],
        "PSNR of training and held-out views, and of images without a model, in dB": [
            "Multiline",
            [rf"^{HELD_OUT_PSNR}$", rf"^{QUALITY}/.*psnr"],
        ],
    },
    "Cost": {
        "time of a step by stage, in milliseconds": ["Multiline", [rf"^{TIME}/.*_ms$"]],
        "peak memory in GB": ["Multiline", [rf"^{MEMORY}/"]],
        "learning rates": ["Multiline", [rf"^{RATES}/"]],
    },
}
"""Page "Custom Scalars": charts with several curves each, by patterns of tags."""


def step_curves(report: StepReport, seconds_left: float | None) -> dict[str, float]:
    """Values of a logged step, by tag.

    Args:
        report: of the step.
        seconds_left: until the end of the run; ``None`` as long as it is not known.
    """
    found: dict[str, float] = {
        f"{OVERVIEW}/loss": report.loss,
        f"{OVERVIEW}/psnr_training": report.psnr,
        COUNT: float(report.num_gaussians),
        f"{OVERVIEW}/step_ms": report.step_ms,
        f"{QUALITY}/skipped_steps": float(report.skipped_steps),
        f"{QUALITY}/image_size": report.resolution,
        **{f"{GAUSSIANS}/{verb}": float(count) for verb, count in report.refined.items()},
        **{f"{LOSSES}/{name}": value for name, value in report.losses.items()},
        **{f"{METHOD}/{name}": value for name, value in report.metrics.items()},
        **{f"{TIME}/{name}_ms": value for name, value in report.stage_ms.items()},
        **{f"{MEMORY}/{name}_gb": mb / 1e3 for name, mb in report.memory_mb.items()},
        **{f"{RATES}/{name}": value for name, value in report.learning_rates.items()},
    }
    if seconds_left is not None:
        found[f"{OVERVIEW}/time_left_minutes"] = seconds_left / 60
    return found


def of_a_step(tag: str) -> bool:
    """True for the tags of ``step_curves``, which no evaluation writes."""
    return tag in STEP_TAGS or tag.startswith((GAUSSIANS, LOSSES, METHOD, TIME, MEMORY, RATES))


def evaluation_curves(evaluation: Evaluation) -> dict[str, float]:
    """Values of an evaluation and of images without a model, by tag."""
    found = {
        HELD_OUT_PSNR if name == "psnr" else f"{QUALITY}/{name}": value
        for name, value in evaluation.means.items()
    }
    for name, value in evaluation.baselines.items():
        if isinstance(value, float):
            found[BASELINE_TAGS.get(name, f"{QUALITY}/no_model_{name}")] = value
    if evaluation.training_psnr is not None:
        found[f"{QUALITY}/psnr_of_training_views"] = evaluation.training_psnr
    return found


def result_curves(summary: Mapping[str, Any]) -> dict[str, float]:
    """Values of a completed run that it has only at its end, by tag."""
    return {f"{RESULT}/{name}": float(summary[name]) for name in RESULTS if name in summary}


def hparam_metrics(summary: Mapping[str, Any]) -> dict[str, float]:
    """Figures of the hparams page, by the tags of the curves that they are the ends of."""
    found = {HELD_OUT_PSNR: summary.get("psnr"), f"{QUALITY}/ssim": summary.get("ssim")}
    found[COUNT] = summary["num_gaussians"]
    known = {tag: float(value) for tag, value in found.items() if value is not None}
    return {**known, **result_curves(summary)}


def requirement_curves(requirements: Requirements) -> dict[str, float]:
    """Floats and dB of every group of a model, by tag."""
    found = {
        f"{REQUIREMENTS}/sh_floats": float(requirements.sh_floats),
        f"{REQUIREMENTS}/sh_floats_full": float(requirements.sh_floats_full),
        f"{REQUIREMENTS}/total_floats": float(requirements.total_floats),
    }
    for group in requirements.groups:
        name = group.name.replace(" ", "_")
        found[f"{REQUIREMENTS}/floats/{name}"] = float(group.floats)
        if group.bought_db is not None:
            found[f"{REQUIREMENTS}/bought_db/{name}"] = group.bought_db
    return found
