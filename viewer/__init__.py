"""The viewer: a page in the browser whose frames are rendered here, by the run's own rasterizer."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_callbacks() -> list[Spec]:
    """The viewer of a run that trains."""
    return [Spec("viewer", "a page to watch and pause a run", "gsfw.viewer.config:ViewerConfig")]
