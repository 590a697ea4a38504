"""`gsfw eval RUN`: the held-out figures of a run, image by image."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import DetailOptions, RunOptions, read_options

if TYPE_CHECKING:
    from pathlib import Path

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.summary import Row
    from gsfw.core.datamanager import Split
    from gsfw.core.loop.evaluation import Evaluation
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.plugins.restore import Restored


KINDS = {"eval": "held-out", "train": "training"}
"""The kinds of views of a split, in words."""
WORST = 5
"""Images that are named as the worst, of more than these."""


@dataclass(kw_only=True)
class EvalOptions(RunOptions, DetailOptions):
    """Compare a run's renders with the photos, image by image."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw eval latest",
        "gsfw eval runs/first split=train json=true",
        "gsfw eval latest budget=100000",
    )

    split: Literal["eval", "train"] = "eval"
    """Split of the images: eval (held out) or train."""


def run(arguments: list[str]) -> int:
    """Evaluate, print a table, and write eval/step_N.json where the run can be written to."""
    options = read_options("eval", EvalOptions, arguments)
    detail = options.drawn()
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run, restore_run
    from gsfw.commands.interface.summary import Row, compared_views, next_rows, summary_text
    from gsfw.core.datamanager import Split
    from gsfw.core.errors import DataError
    from gsfw.plugins.registry import installed

    console = Console(options.json)
    found = find_run(options.run, console.say)
    restored = restore_run(found, installed(), options.changed(), detail=detail)
    parts = restored.composition.parts
    split = Split(options.split)
    if len(parts.data.views(split)) == 0:
        raise DataError(
            f"{found.name} has no held-out images to evaluate.",
            "Evaluate those it was trained on with split=train.",
        )
    evaluation = evaluate_run(restored, split)
    document = {
        "run": found.name,
        "step": restored.step,
        "num_gaussians": parts.model.num_rows,
        **({"budget": detail.budget, "detail": detail.pixels} if detail.is_given else {}),
        **evaluation.document(),
        "protocol": _protocol(restored, split),
    }
    suffix = ("" if split is Split.EVAL else f"_{options.split}") + detail.suffix
    path = found.folder.evaluations / f"step_{restored.step:09d}{suffix}.json"
    files = _written(found.folder, path, document, evaluation, console)
    views = compared_views(evaluation.count, KINDS[options.split], document["protocol"])
    shown = _shown(evaluation, document["protocol"])
    _show_views(console, shown, f"{found.name}, step {restored.step}: {views}")
    rows = _rows(shown, views)
    rows += [Row("files", ", ".join(map(str, files)))] if files else []
    rows += next_rows(found.name, ("view", "report", "render"))
    console.say("\n" + summary_text(f"{found.name} after {restored.step} steps", rows))
    for finding in evaluation.findings or ():
        console.warn(finding.message)
    console.result(document)
    return 0


def evaluate_run(restored: Restored, split: Split) -> Evaluation:
    """Evaluate and judge the views of a split."""
    from gsfw.core.loop.determinism import deterministic
    from gsfw.core.loop.evaluation import evaluate
    from gsfw.core.loop.verdict import Verdict

    parts, plan = restored.composition.parts, restored.composition.plan
    verdict = Verdict(parts, plan, restored.composition.settings.flat(), split)
    with deterministic(parts.device):
        evaluation = evaluate(
            parts,
            plan.settings,
            split,
            method=parts.method,
            baselines=verdict.baselines,
            step=restored.step,
        )
        return verdict.judge(restored.step, evaluation)


def _protocol(restored: Restored, split: Split) -> dict[str, Any]:
    """The measurement protocol; it names the step of an earlier checkpoint."""
    protocol = restored.composition.protocol(split)
    steps = restored.composition.plan.steps
    if restored.step < steps:
        protocol["checkpoint"] = f"after step {restored.step} of {steps}"
    return protocol


def _written(
    folder: RunFolder,
    path: Path,
    document: Mapping[str, Any],
    evaluation: Evaluation,
    console: Console,
) -> list[Path]:
    """Write the document and, for a moving scene, the curve over time; the files.

    Where they cannot be written, a warning says so: the figures are printed all the same.
    """
    from gsfw.charts.time_plot import write_time_plot
    from gsfw.core.errors import OutputError

    files: list[Path] = []
    try:
        folder.write_json(path, document)
        files.append(path)
        plot = write_time_plot(path, evaluation)
        files += [] if plot is None else [plot]
    except OutputError as error:
        only = "" if files else " The figures are printed only; json=true prints all of them."
        console.warn(f"{error.message}{only}")
    return files


def _shown(evaluation: Evaluation, protocol: Mapping[str, Any]) -> Evaluation:
    """The evaluation with the metrics worth a row; the document has all of them."""
    from gsfw.core.words import shown_metrics

    def picked(figures: Mapping[str, float]) -> dict[str, float]:
        return {name: figures[name] for name in shown_metrics(figures, protocol)}

    per_view = tuple(map(picked, evaluation.per_view))
    return replace(evaluation, per_view=per_view, means=picked(evaluation.means))


def _show_views(console: Console, evaluation: Evaluation, title: str) -> None:
    """Print the figures of each image."""
    # Flicker belongs to pairs of images, so it has no column here.
    names = list(dict.fromkeys(name for figures in evaluation.per_view for name in figures))
    rows: list[Sequence[str]] = [
        [view, *(_cell(figures.get(name)) for name in names)]
        for view, figures in _views(evaluation)
    ]
    rows.append(["mean", *(_cell(evaluation.means.get(name)) for name in names)])
    console.table(["image", *names], rows, title)


def _views(evaluation: Evaluation) -> list[tuple[str, Mapping[str, float]]]:
    """The images with their figures, by name."""
    views = zip(evaluation.views, evaluation.per_view, strict=True)
    return sorted(views, key=lambda view: natural(view[0]))


def _rows(evaluation: Evaluation, views: str) -> list[Row]:
    """The figures of all images together, and the worst images; ``views``: the images in words."""
    from gsfw.commands.interface.summary import Row, quality_rows

    rows = quality_rows(evaluation.means, evaluation.baselines, views)
    rows += [Row("", "", f"{name}: {note}") for name, note in evaluation.notes.items()]
    each = _views(evaluation)
    if len(each) > WORST:
        known = sorted((figures["psnr"], view) for view, figures in each if "psnr" in figures)
        texts = [f"{view} {value:.2f}" for value, view in known[:WORST]]
        rows += (
            [Row("worst", f"{known[0][0]:.2f} dB", f"PSNR: {', '.join(texts)}")] if known else []
        )
    if each:
        rows.append(Row("rendering", f"{evaluation.render_ms:.1f} ms", "an image, median"))
    return rows


def natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts r_2 before r_10: numbers in a name count as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(int(part) if part.isdecimal() else -1, part) for part in parts]


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
