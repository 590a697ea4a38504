"""Opening: the model of a finished run, of a model file, or of another tool's splats."""

from __future__ import annotations

from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import is_dynamic
from gsfw.viewer.viewed_model import ViewedModel


def of_restored(
    name: str, restored: Restored, has_cameras: bool = True, subject: str = ""
) -> ViewedModel:
    """The model of an opened run, or of a file.

    Args:
        name: of the run or file, for the page.
        restored: as ``open_run`` returns it.
        has_cameras: false if nobody stood at the cameras of the data, as for a splat file.
        subject: method and scene of a run; empty for a file.
    """
    composition = restored.composition
    parts = composition.parts
    return ViewedModel(
        name=name,
        model=parts.model,
        rasterizer=parts.rasterizer,
        settings=composition.plan.settings,
        scene=composition.scene,
        device=parts.device,
        data=parts.data,
        is_dynamic=is_dynamic(composition),
        has_cameras=has_cameras,
        subject=subject,
    )
