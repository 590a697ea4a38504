"""Opening: the model of a finished run, of a model file, or of another tool's splats."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature, Needs
from gsfw.core.column import Column
from gsfw.core.config import AUTO
from gsfw.core.exchange import SplatFile
from gsfw.core.model import PrimitiveModel
from gsfw.core.progress import stage
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.plugins.automatic import choose_device
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import is_dynamic
from gsfw.viewer.viewed_model import ViewedModel


def of_restored(name: str, restored: Restored) -> ViewedModel:
    """The model of an opened run, or of a model file."""
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
    )


class FixedSplats(PrimitiveModel):
    """Splats of a file, which neither move nor train."""

    def __init__(self, splats: Splats) -> None:
        """Hold these splats."""
        super().__init__()
        self._splats = splats
        self._columns = {"means": Column(splats.means)}

    def columns(self) -> Mapping[str, Column]:
        """The positions."""
        return self._columns

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The splats of the file, at any time."""
        return self._splats


def of_splat_file(path: Path, device: str, registry: Registry) -> ViewedModel:
    """The splats of another tool's file.

    Raises:
        DataError: it cannot be read; names the cause.
    """
    with stage(f"reading {path.name}"):
        content = find_importer(path, registry).read(path)
    chosen, rasterizer = _rasterizer(content, device or AUTO, registry)
    splats = content.splats.map(torch.Tensor.float).to(chosen)
    nowhere = torch.zeros(0, 3)
    settings = RenderSettings(
        background=torch.zeros(3, device=chosen), antialias=content.antialiased
    )
    return ViewedModel(
        name=str(path),
        model=FixedSplats(splats),
        rasterizer=rasterizer,
        settings=settings,
        scene=Scene(path.stem, nowhere, nowhere, nowhere, 1.0, up=content.up),
        device=chosen,
    )


def _rasterizer(
    content: SplatFile, device: str, registry: Registry
) -> tuple[torch.device, Rasterizer]:
    """The fastest rasterizer for a file, and its device."""
    features = {Feature.SH} | ({Feature.ANTIALIAS} if content.antialiased else set())
    needs = {"the file": Needs(features=frozenset(features))}
    place, choice = choose_device(device, AUTO, registry, needs)
    assert choice is not None, "the rasterizer is open"
    where = torch.device(device if place is None else place.name)
    kind = load("rasterizer", registry.find("rasterizer", choice.name))
    return where, kind().build(where)
