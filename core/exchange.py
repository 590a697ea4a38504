"""Exporter and Importer: splats to and from files of other tools."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from gsfw.core.splats import Splats
from gsfw.core.stored_model import StoredModel
from gsfw.core.temporal_metrics.tracks import Tracks


@dataclass(frozen=True)
class SplatFile:
    """A set of splats as files hold it: activated, in the world of the data."""

    splats: Splats
    """Quats and scales form with dense SH colours; float64 on the CPU, so that nothing is lost on
    the way through the scene frame."""
    antialiased: bool = False
    """Whether it was trained with antialiasing, and should be drawn so."""
    up: str = ""
    """Which way is up in the data's world ("-y" for COLMAP, "z"); empty when unknown."""
    properties: Mapping[str, str] = field(default_factory=dict)
    """What else the file says of itself, for ``gsfw info``."""


class Exporter(ABC):
    """Writes one file format."""

    suffix: str
    """Of the file's name, with the dot."""

    @abstractmethod
    def write(self, path: Path, content: SplatFile) -> None:
        """Write the file, whole or not at all.

        Raises:
            OutputError: it cannot be written.
            ValueError: a splat has a value that is not finite; names the field and the row.
        """


class ModelExporter(ABC):
    """Writes a file format that holds a model as a whole; registered as exporters are."""

    suffix: str
    """Of the file's name, with the dot."""

    @abstractmethod
    def write(self, path: Path, model: StoredModel) -> None:
        """Write the file, whole or not at all.

        Raises:
            OutputError: it cannot be written.
            ValueError: the model has state that the format cannot hold; names it.
        """


@dataclass(frozen=True)
class TrackFile:
    """The paths of all rows of a model as files hold them, on the CPU."""

    tracks: Tracks
    """In the world of the data, in float64."""
    origin: Float[Tensor, " 3"]
    """A place in that world that the paths are near to: files may hold positions from there."""
    data_times: tuple[float, ...]
    """The times in the data's own unit."""
    colors: Float[Tensor, "n 3"]
    """What each row looks like when it is there for the first time, in [0, 1]."""


class TrackExporter(ABC):
    """Writes a file format that holds paths; registered as exporters are."""

    suffix: str
    """Of the file's name, with the dot."""

    @abstractmethod
    def write(self, path: Path, content: TrackFile) -> None:
        """Write the file, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """


class Importer(ABC):
    """Reads one file format."""

    @classmethod
    @abstractmethod
    def recognises(cls, path: Path) -> bool:
        """Whether a file looks like this format, from its first bytes; never raises."""

    @abstractmethod
    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged or not of this format; says where and why.
        """
