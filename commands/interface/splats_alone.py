"""Splats alone: the splats.ply of a finished run takes its place where the data set is gone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from gsfw.commands.interface.runs import RunArgument
from gsfw.core.errors import UserError
from gsfw.core.files.json_text import parsed_json
from gsfw.core.loop.run_folder import RunFolder

LACKING = {
    "depends_on_view": "the splats of the model depend on the view, and those of the file do not",
    "decodes_colors": "the model changes colours after rendering, which the file does not hold",
}
"""Causes why the file looks different from renders of the model, by figure of the finished run."""


def or_splats_alone(
    found: RunArgument, data: str, step: int | None, warn: Callable[[str], None]
) -> RunArgument:
    """The run; its file of splats if its data set is gone and the splats are the whole model.

    That is so for the last step of a finished run on a still scene. Another run keeps the error of
    its opening, which names the remedies.

    Args:
        found: the argument RUN.
        data: place of the data set that the user gives; empty for its place in training.
        step: step of the checkpoint that the user gives; ``None`` for the latest.
        warn: receives a sentence on what is missing.
    """
    is_run = found.model_file is None and found.splat_file is None
    if not is_run or data or step is not None or found.checkpoint is not None:
        return found
    folder = found.folder
    gone, figures = _gone_data(folder), _final_figures(folder)
    moves = "bytes_per_time" in figures
    if not gone or not folder.splats.is_file() or not figures or moves:
        return found
    seen = "".join(
        f" It may look different: {cause}."
        for figure, cause in LACKING.items()
        if figures.get(figure)
    )
    warn(
        f"{folder.path} was trained on {gone}, which is not there any more. {folder.splats} takes "
        f"its place, without photos, with made-up cameras around it.{seen} If the data set is "
        "somewhere else: data=PATH."
    )
    return replace(found, splat_file=folder.splats)


def _gone_data(folder: RunFolder) -> str:
    """Place of the data set of a run where it is gone; else empty, also if settings are damaged."""
    from gsfw.plugins.config_file import read_config
    from gsfw.plugins.restore import is_gone

    with suppress(UserError):
        data = str(read_config(folder.config, everything=True).values.get("data") or "")
        return data if is_gone(data) else ""
    return ""


def _final_figures(folder: RunFolder) -> Mapping[str, Any]:
    """The final figures of a finished run; empty of another one, also if they are damaged."""
    if not folder.is_finished:
        return {}
    try:
        figures = parsed_json(folder.summary.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return figures if isinstance(figures, dict) else {}
