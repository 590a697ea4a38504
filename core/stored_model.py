"""StoredModel: a trained model and all that it takes to draw it, without its data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.datamanager import Split, Views
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene


@dataclass(frozen=True)
class StoredColumn:
    """Where a column of the model lies in its state."""

    layout: Layout
    values: str
    """Name of its values in the state."""
    offsets: str | None = None
    """Name of its offsets in the state; ``None`` unless ragged."""


@dataclass(frozen=True)
class StoredModel:
    """What a file of the whole model holds; everything but the optimizer and the pictures."""

    method: str
    """As ``method=NAME`` has it."""
    distribution: str
    """The package that brings the method."""
    distribution_version: str
    settings: Mapping[str, Any]
    """Every setting of the run by dotted key, as plain data."""
    step: int
    """Steps it was trained for."""
    rows: int
    """Number of primitives."""
    scene: Scene
    """Of the capture, without its points."""
    views: Mapping[Split, Views]
    """The capture's cameras, in the scene frame."""
    render: RenderSettings
    """How the run drew it."""
    columns: Mapping[str, StoredColumn]
    """The quantities that there is one of per primitive, by name."""
    state: Mapping[str, Tensor]
    """All tensors of the model's ``state_dict``, on the CPU."""
