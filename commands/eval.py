"""`gsfw eval RUN`: the held-out figures of a run, picture by picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.arguments import read
from gsfw.commands.run_options import RunOptions

if TYPE_CHECKING:
    from gsfw.commands.console import Console
    from gsfw.core.evaluation import Evaluation


@dataclass(kw_only=True)
class EvalOptions(RunOptions):
    """Compare a run's renders with the photos, picture by picture."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw eval latest",
        "gsfw eval runs/first split=train json=true",
    )

    split: Literal["eval", "train"] = "eval"
    """Which pictures: eval (held out) or train."""


def run(arguments: list[str]) -> int:
    """Evaluate, print a table, and write eval/step_N.json."""
    options = read("eval", EvalOptions, arguments)

    from gsfw.commands.console import Console
    from gsfw.commands.run_argument import find_run
    from gsfw.core.datamanager import Split
    from gsfw.core.determinism import deterministic
    from gsfw.core.errors import DataError
    from gsfw.core.evaluation import evaluate
    from gsfw.plugins.registry import installed
    from gsfw.plugins.restore import restore

    console = Console(options.json)
    found = find_run(options.run)
    restored = restore(found.folder, installed(), found.checkpoint, options.changed())
    parts, plan = restored.composition.parts, restored.composition.plan
    split = Split(options.split)
    if len(parts.data.views(split)) == 0:
        raise DataError(
            f"{found.folder.path} has no held-out pictures to evaluate.",
            "Evaluate those it was trained on with split=train.",
        )
    with deterministic(parts.device):
        evaluation = evaluate(
            parts.model,
            parts.rasterizer,
            parts.data,
            parts.metrics,
            plan.settings,
            parts.device,
            split,
        )
    protocol = restored.composition.protocol(split)
    document = {
        "run": str(found.folder.path),
        "step": restored.step,
        "num_gaussians": parts.model.num_rows,
        **evaluation.document(),
        "protocol": protocol,
    }
    suffix = "" if split is Split.EVAL else f"_{options.split}"
    path = found.folder.evaluations / f"step_{restored.step:09d}{suffix}.json"
    found.folder.write_json(path, document)
    _show(console, evaluation, f"{found.folder.path}, step {restored.step}, {options.split} views")
    console.say(f"written: {path}")
    console.result(document)
    return 0


def _show(console: Console, evaluation: Evaluation, title: str) -> None:
    names = list(evaluation.means)
    rows: list[Sequence[str]] = [
        [view, *(f"{figures[name]:.4f}" for name in names)]
        for view, figures in zip(evaluation.views, evaluation.per_view, strict=True)
    ]
    rows.append(["mean", *(f"{evaluation.means[name]:.4f}" for name in names)])
    console.table(["picture", *names], rows, title)
    console.say(f"drawing one picture takes {evaluation.render_ms:.1f} ms (median)")
