"""Export: the Gaussians that a page shows, as a 3DGS PLY for other tools."""

from __future__ import annotations

from pathlib import Path

import torch

from gsfw.core.exchange import Exporter
from gsfw.formats.visible_splats import without_invisible
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed
from gsfw.plugins.snapshot import snapshot, view_notes
from gsfw.viewer.shown_model import edited
from gsfw.viewer.view_state import ViewState
from gsfw.viewer.viewed_model import ViewedModel


def export_splats(model: ViewedModel, state: ViewState, path: Path) -> tuple[int, list[str]]:
    """Write what the page shows at its time: cropped and scaled.

    Returns:
        The number of Gaussians, and a warning if those of the page's view differ.

    Raises:
        OutputError: it cannot be written.
        ValueError: a value is out of the range of the format.
    """
    moment = torch.tensor(state.time, device=model.device) if model.is_dynamic else None
    taken = snapshot(
        model.model,
        model.scene,
        model.settings.antialias,
        moment,
        lambda splats: edited(splats, state),
    )
    content, _ = without_invisible(taken)
    exporter: Exporter = load("exporter", installed().find("exporter", "ply"))()
    exporter.write(path, content)
    seen = state.pose.cameras(1, 1).to(model.device)
    return len(content.splats), view_notes(model.model, seen, moment)
