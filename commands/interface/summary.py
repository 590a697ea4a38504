"""Summary: the end of a run, or of an evaluation, as one table with files and next commands."""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gsfw.commands.interface.console import WIDTH_OF_FILES
from gsfw.core.words import duration, metric_name, shell_argument, shown_metrics, size
from gsfw.plugins.registry import installed
from gsfw.reports.plain_text import image_sizes

if TYPE_CHECKING:
    from pathlib import Path

    from gsfw.core.loop.run_folder import RunFolder

MARGIN, GAP = "  ", "   "
"""Before each line of a table, and between its columns."""
LEAST_REMARK = 24
"""Columns of a remark at least; values that leave fewer have theirs below."""

FIRST_METRICS = ("psnr", "kept_psnr", "ssim", "moving_psnr")
"""Metrics at the top of the table; others follow."""


@dataclass(frozen=True)
class Row:
    """One line of a summary."""

    name: str
    """Empty: the line belongs to the one above."""
    value: str
    remark: str = ""


def quality_rows(
    means: Mapping[str, float | None], baselines: Mapping[str, Any], views: str
) -> list[Row]:
    """Rows of the metrics, PSNR first, with that of images without a model.

    Args:
        means: metrics by name, NaN or ``None`` for one that failed; empty without views.
        baselines: PSNR of images that need no model, by name.
        views: the compared views, in words, as ``compared_views`` gives them.
    """
    if not means:
        return [Row("PSNR", "-", "there are no held-out views to measure it on")]
    from gsfw.core.loop.baselines import NAMES  # Not at the top: it imports torch.

    known = [(name, baselines.get(key)) for key, name in NAMES.items()]
    others = [f"{name} has {value:.2f} dB" for name, value in known if isinstance(value, float)]
    remarks = {"psnr": "; ".join([f"mean of {views}", *others])}
    moving = baselines.get("constant_moving_psnr")
    remarks["color_corrected_psnr"] = "each render's colours fitted to its photo first"
    remarks["kept_psnr"] = "of the pixels that ignore_distractors=true keeps"
    remarks["moving_psnr"] = "of the moving region"
    if isinstance(moving, float):
        remarks["moving_psnr"] += f"; one colour has {moving:.2f} dB there"
    names = [name for name in FIRST_METRICS if name in means]
    names += [name for name in means if name not in names]
    return [Row(_words(name), _figure(name, means[name]), remarks.get(name, "")) for name in names]


def _words(name: str) -> str:
    """The name of a metric, without what its remark says."""
    return metric_name("psnr" if name == "moving_psnr" else name)


def _figure(name: str, value: float | None) -> str:
    value = math.nan if value is None else value  # JSON has null for NaN.
    return f"{value:.2f} dB" if name.endswith("psnr") else f"{value:.4f}"


def run_rows(
    summary: Mapping[str, Any], metrics: Iterable[str], requirements: str = "", invisible: int = 0
) -> list[Row]:
    """Rows of a completed run: quality, Gaussians, time, memory and size.

    Args:
        summary: the figures of metrics.json.
        metrics: names of the run's metrics.
        requirements: what the parts of the model are worth, as a phrase; empty if not measured.
        invisible: Gaussians that splats.ply leaves out.
    """
    protocol = summary.get("protocol", {})
    names = shown_metrics((*FIRST_METRICS, *metrics), protocol)
    means = {name: summary[name] for name in names if name in summary}
    views = compared_views(str(summary["views"]), "held-out", protocol)
    rows = quality_rows(means, summary.get("baselines", {}), views)
    remark = f"{invisible:,} are too faint to be seen, and not in splats.ply" if invisible else ""
    rows.append(Row("Gaussians", f"{summary['num_gaussians']:,}", remark))
    skipped = summary.get("skipped_steps", 0)
    steps = f"{summary['steps']:,} steps"
    if "updates" in summary:  # To end in time, a planned run takes several steps with an update.
        steps = f"{summary['updates']:,} updates, which count as {steps} of the schedule"
    remark = f"{steps}, without loading and measuring"
    remark += f"; {skipped} steps were not finite, and skipped" if skipped else ""
    rows.append(Row("training", duration(summary["train_seconds"]), remark))
    if summary["views"]:
        rows.append(Row("rendering", f"{summary['render_ms']:.1f} ms", "an image, median"))
    peaks = [
        (key, of)
        for key, of in (("peak_memory_mb", ""), ("peak_gpu_memory_mb", " of GPU"))
        if summary.get(key)
    ]
    if peaks:
        words = ", ".join(f"{size(1e6 * summary[key])}{of}" for key, of in peaks)
        rows.append(Row("memory", words, "at most"))
    each = summary.get("bytes_per_time")
    remarks = [] if each is None else [f"{size(each)} for each captured time"]
    remarks += [requirements] if requirements else []
    rows.append(Row("model", size(summary["model_bytes"]), "; ".join(remarks)))
    return rows


def compared_views(count: str, kind: str, protocol: Mapping[str, Any]) -> str:
    """The compared views in words: "7 held-out views of 239 x 427 pixels".

    Args:
        count: their number, of all where they are a sample: "30 of 200".
        kind: "held-out" or "training".
        protocol: the measurement protocol of the figures; empty if unknown.
    """
    sizes = image_sizes(protocol)
    views = f"{count} {kind} view{'' if count == '1' else 's'}"
    return f"{views} of {sizes}" if sizes else views


def file_rows(folder: RunFolder, others: Iterable[Path] = ()) -> list[Row]:
    """The folder of a run, and the files in it that people look at.

    Args:
        folder: of the run.
        others: further files of this run.
    """
    results = (folder.report, folder.splats, *others)
    looked_at = (*results, folder.requirements_plot, folder.summary, folder.log)
    files = [
        f"{path.name} ({size(path.stat().st_size)})" if path == folder.splats else path.name
        for path in looked_at
        if path.is_file()
    ]
    return [Row("folder", str(folder.path)), Row("files", ", ".join(files))]


def next_rows(run: str, verbs: Iterable[str], others: Iterable[str] = ()) -> list[Row]:
    """The commands that may follow, the most wanted first.

    Args:
        run: path of the run or model file.
        verbs: verbs that take it, of which the installed ones are named.
        others: whole commands.
    """
    known = installed().slot("command")
    commands = [f"gsfw {verb} {shell_argument(run)}" for verb in verbs if verb in known]
    commands += others
    return [Row("next" if place == 0 else "", text) for place, text in enumerate(commands)]


def summary_text(title: str, *groups: Sequence[Row]) -> str:
    """Groups of rows as a table, with a blank line before each.

    Names and values are never broken, so that paths and commands can be copied; remarks wrap, below
    their values where these are too long.
    """
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDTH_OF_FILES
    names = max(len(row.name) for group in groups for row in group)
    most = columns - len(MARGIN) - names - 2 * len(GAP) - LEAST_REMARK
    beside = [row.value for group in groups for row in group if row.remark]
    values = max((len(value) for value in beside if len(value) <= most), default=0)
    lines = [title]
    for group in groups:
        lines.append("")
        for row in group:
            start = f"{MARGIN}{row.name:{names}}{GAP}"
            head = f"{start}{row.value:{values}}{GAP}"
            if row.remark and len(row.value) > values:
                lines.append(f"{start}{row.value}")
                head = " " * len(start)
            first, *rest = textwrap.wrap(row.remark, max(columns - len(head), LEAST_REMARK)) or [""]
            lines.append(f"{head}{first}".rstrip())
            lines += [" " * len(head) + line for line in rest]
    return "\n".join(lines)
