"""`gsfw eval RUN`: the held-out figures of a run, image by image."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import RunOptions, read

if TYPE_CHECKING:
    from pathlib import Path

    from gsfw.commands.interface.console import Console
    from gsfw.core.datamanager import Split
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.plugins.restore import Restored


WORST = 5
"""Images that are named as the worst, of more than these."""


@dataclass(kw_only=True)
class EvalOptions(RunOptions):
    """Compare a run's renders with the photos, image by image."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw eval latest",
        "gsfw eval runs/first split=train json=true",
    )

    split: Literal["eval", "train"] = "eval"
    """Split of the images: eval (held out) or train."""


def run(arguments: list[str]) -> int:
    """Evaluate, print a table, and write eval/step_N.json."""
    options = read("eval", EvalOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run, open_run
    from gsfw.core.datamanager import Split
    from gsfw.core.errors import DataError
    from gsfw.plugins.registry import installed

    console = Console(options.json)
    found = find_run(options.run, console.say)
    restored = open_run(found, installed(), options.changed())
    parts = restored.composition.parts
    split = Split(options.split)
    if len(parts.data.views(split)) == 0:
        raise DataError(
            f"{found.name} has no held-out images to evaluate.",
            "Evaluate those it was trained on with split=train.",
        )
    evaluation = _evaluate(restored, split)
    document = {
        "run": found.name,
        "step": restored.step,
        "num_gaussians": parts.model.num_rows,
        **evaluation.document(),
        "protocol": _protocol(restored, split),
    }
    _show(console, evaluation, f"{found.name}, step {restored.step}, {options.split} views")
    suffix = "" if split is Split.EVAL else f"_{options.split}"
    path = found.folder.evaluations / f"step_{restored.step:09d}{suffix}.json"
    _write(console, found.folder, path, document, evaluation)
    console.result(document)
    return 0


def _evaluate(restored: Restored, split: Split) -> Evaluation:
    """Evaluate and judge the views of a split."""
    from gsfw.core.loop.determinism import deterministic
    from gsfw.core.loop.evaluation import evaluate
    from gsfw.core.loop.verdict import Verdict

    parts, plan = restored.composition.parts, restored.composition.plan
    verdict = Verdict(parts, plan, restored.composition.settings.flat(), split)
    with deterministic(parts.device):
        evaluation = evaluate(
            parts.model,
            parts.rasterizer,
            parts.data,
            parts.metrics,
            plan.settings,
            parts.device,
            split,
            method=parts.method,
            baselines=verdict.baselines,
        )
        return verdict.judge(restored.step, evaluation)


def _protocol(restored: Restored, split: Split) -> dict[str, Any]:
    """The measurement protocol; it names the step of an earlier checkpoint."""
    protocol = restored.composition.protocol(split)
    steps = restored.composition.plan.steps
    if restored.step < steps:
        protocol["checkpoint"] = f"after step {restored.step} of {steps}"
    return protocol


def _write(
    console: Console,
    folder: RunFolder,
    path: Path,
    document: Mapping[str, Any],
    evaluation: Evaluation,
) -> None:
    """Write the document and, for a moving scene, the curve over time."""
    from gsfw.charts.time_plot import write_time_plot

    folder.write_json(path, document)
    console.say(f"written: {path}")
    plot = write_time_plot(path, evaluation)
    if plot is not None:
        console.say(f"curve over time: {plot}")


def _show(console: Console, evaluation: Evaluation, title: str) -> None:
    # Flicker belongs to pairs of images, so it has no column here.
    names = list(dict.fromkeys(name for figures in evaluation.per_view for name in figures))
    views = sorted(
        zip(evaluation.views, evaluation.per_view, strict=True), key=lambda view: natural(view[0])
    )
    rows: list[Sequence[str]] = [
        [view, *(_cell(figures.get(name)) for name in names)] for view, figures in views
    ]
    rows.append(["mean", *(_cell(evaluation.means.get(name)) for name in names)])
    console.table(["image", *names], rows, title)
    if len(views) > WORST:
        worst = sorted(views, key=lambda view: view[1].get("psnr", math.inf))[:WORST]
        texts = (f"{view} {_cell(figures.get('psnr'))}" for view, figures in worst)
        console.say(f"worst by PSNR: {', '.join(texts)}")
    for name in evaluation.means:
        if name not in names:
            console.say(f"{name}: {evaluation.means[name]:.5f}")
    for name, note in evaluation.notes.items():
        console.say(f"{name}: {note}")
    console.say(f"rendering one image takes {evaluation.render_ms:.1f} ms (median)")
    for name in ("constant_psnr", "mean_image_psnr", "still_psnr"):
        if name in evaluation.baselines:
            console.say(f"baseline {name}: {evaluation.baselines[name]:.4f}")
    for finding in evaluation.findings or ():
        console.warn(finding.message)


def natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts r_2 before r_10: numbers in a name count as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(int(part) if part.isdecimal() else -1, part) for part in parts]


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
