"""Exchange: exporters and importers, and the contents of files: splats, tracks, whole models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.datamanager import Split, Views
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.temporal_metrics.tracks import Tracks


class ExportSource:
    """Content for exporters; an exporter asks for the one that its format holds.

    A run is a source of everything; ``SplatFile``, ``TrackFile`` and ``StoredModel`` are sources of
    themselves.
    """

    def splat_file(self) -> SplatFile:
        """The splats at one time, in the world of the data.

        Raises:
            ValueError: the source has none.
        """
        raise ValueError("there are no splats to write")

    def track_file(self) -> TrackFile:
        """The paths of all rows, in the world of the data.

        Raises:
            ValueError: the source has none.
        """
        raise ValueError("there are no tracks to write")

    def stored_model(self) -> StoredModel:
        """The whole model.

        Raises:
            ValueError: the source has none, or the model has state that cannot be stored.
        """
        raise ValueError("there is no model to write")


@dataclass(frozen=True)
class SplatFile(ExportSource):
    """A set of splats for files: activated, in the world of the data."""

    splats: Splats
    """Quats and scales form with dense SH colours; float64 on the CPU, so that the transform to the
    scene frame loses no precision."""
    antialiased: bool = False
    """True if the splats were trained, and should be rendered, with antialiasing."""
    up: str = ""
    """Up direction in the data's world ("-y" for COLMAP, "z"); empty when unknown."""
    properties: Mapping[str, str] = field(default_factory=dict)
    """Further properties that the file states, for ``gsfw info``."""

    def splat_file(self) -> SplatFile:
        """The file itself."""
        return self


@dataclass(frozen=True)
class TrackFile(ExportSource):
    """The paths of all rows of a model for files, on the CPU."""

    tracks: Tracks
    """In the world of the data, in float64."""
    origin: Float[Tensor, " 3"]
    """A point near the paths in that world; files may store positions relative to it."""
    data_times: tuple[float, ...]
    """The times in the data's own unit."""
    colors: Float[Tensor, "n 3"]
    """Colour of each row when it is present for the first time, in [0, 1]."""

    def track_file(self) -> TrackFile:
        """The file itself."""
        return self


@dataclass(frozen=True)
class StoredColumn:
    """Position of a model's column in its state."""

    layout: Layout
    values: str
    """Name of its values in the state."""
    offsets: str | None = None
    """Name of its offsets in the state; ``None`` unless ragged."""


@dataclass(frozen=True)
class StoredModel(ExportSource):
    """A trained model with everything needed to render it; without optimizer and images."""

    method: str
    """Name of the method, as in ``method=NAME``."""
    distribution: str
    """The package that provides the method."""
    distribution_version: str
    settings: Mapping[str, Any]
    """Every setting of the run by dotted key, as plain data."""
    step: int
    """Number of training steps."""
    rows: int
    """Number of primitives."""
    scene: Scene
    """The scene of the capture, without its points."""
    views: Mapping[Split, Views]
    """The capture's cameras, in the scene frame."""
    render: RenderSettings
    """Render settings of the run."""
    columns: Mapping[str, StoredColumn]
    """The per-primitive quantities by name."""
    state: Mapping[str, Tensor]
    """All tensors of the model's ``state_dict``, on the CPU."""

    def stored_model(self) -> StoredModel:
        """The model itself."""
        return self


class Holds(Enum):
    """Content of one file of a format."""

    SPLATS = "splats at one time"
    TRACKS = "paths of all Gaussians over time"
    MODEL = "the whole model"


class Exporter(ABC):
    """Writer of one file format."""

    suffix: str
    """Suffix of file names, with the dot."""
    holds: Holds = Holds.SPLATS
    """Content of a file; the exporter reads only this from its source."""

    @abstractmethod
    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: the format cannot hold the content, such as a splat with a value that is not
                finite or state of an unknown type; names the field and the row.
        """


class Importer(ABC):
    """Reader of one file format."""

    @classmethod
    @abstractmethod
    def recognises(cls, path: Path) -> bool:
        """True if the first bytes of a file look like this format; never raises."""

    @abstractmethod
    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged or not of this format; names the cause and the place.
        """
