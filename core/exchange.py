"""Exchange: exporters, importers, and contents of files: splats, motion, tracks, models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Layout
from gsfw.core.datamanager import Split, Views
from gsfw.core.files.reading import bytes_of
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.temporal_metrics.tracks import Tracks


class ExportSource:
    """Content for exporters; an exporter asks for the one that its format holds.

    A run is a source of everything; ``SplatFile``, ``MotionFile``, ``TrackFile`` and
    ``StoredModel`` are sources of themselves.
    """

    def splat_file(self) -> SplatFile:
        """The splats at one time, in the world of the data.

        Raises:
            ValueError: the source has none.
        """
        raise ValueError("there are no splats to write")

    def motion_file(self, *, pieces: bool = True) -> MotionFile:
        """The splats at all times, each with its motion in closed form, in the world of the data.

        Args:
            pieces: false for formats without intervals of presence: each splat then has one motion
                for all times, however far that is from the model's.

        Raises:
            ValueError: the source has none, or only one in pieces.
        """
        raise ValueError("there is no motion to write")

    def cameras(self) -> Sequence[Cameras]:
        """The training cameras, float64, in the world of the data; none if none are known."""
        return ()

    def preview(self) -> Preview | None:
        """The first sight of the scene on a page; ``None`` if the source knows no cameras."""
        return None

    def track_file(self) -> TrackFile:
        """The paths of all rows, in the world of the data.

        Raises:
            ValueError: the source has none.
        """
        raise ValueError("there are no tracks to write")

    def depth_views(self) -> Sequence[DepthView]:
        """Views with depth, at one time, in the world of the data.

        Raises:
            ValueError: the source cannot render.
        """
        raise ValueError("there are no depth images to fuse")

    def stored_model(self) -> StoredModel:
        """The whole model.

        Raises:
            ValueError: the source has none, or the model has state that cannot be stored.
        """
        raise ValueError("there is no model to write")

    def contributions(self) -> Float[Tensor, " n"] | None:
        """Contribution of each row of the model to the training views, which takes a while.

        Alpha times transmittance, summed over all pixels; ``None`` where nothing can measure it.
        """
        return None


@dataclass(frozen=True)
class SplatFile(ExportSource):
    """A set of splats for files: activated, in the world of the data."""

    splats: Splats
    """Quats and scales form with dense SH colours, on the CPU. Means, opacities, quats and scales
    are float64, so that the transform to the scene frame loses no precision; colours may be
    float32, which most files hold."""
    antialiased: bool = False
    """True if the splats were trained, and should be rendered, with antialiasing."""
    up: str = ""
    """Up direction in the data's world ("-y" for COLMAP, "z"); empty when unknown."""
    properties: Mapping[str, str] = field(default_factory=dict)
    """Further properties that the file states, for ``gsfw info``."""
    num_dropped: int = 0
    """Rows of a file or model that were left out, as a value of theirs is not finite."""

    def notes(self) -> tuple[str, ...]:
        """A sentence on the rows that were not read, if there are any."""
        if self.num_dropped == 0:
            return ()
        one = self.num_dropped == 1
        rows = "row of the file is" if one else "rows of the file are"
        whose = "its" if one else "their"
        return (f"{self.num_dropped:,} {rows} left out: {whose} values are not all finite.",)

    def splat_file(self) -> SplatFile:
        """The file itself."""
        return self

    def motion_file(self, *, pieces: bool = True) -> MotionFile:
        """The same splats, at rest."""
        return MotionFile(self, Motion.none(len(self.splats)))


@dataclass(frozen=True)
class Motion:
    """Motion of ``n`` splats in closed form: polynomials of the time since each one's centre.

    With d = t - center, a splat has at time t the mean ``mean + path . (d, d^2, d^3)``, the
    quaternion ``quat + spin d`` (normalised afterwards), the scales ``scale exp(growth d)``, and
    the opacity ``opacity exp(-(d / width)^2)``; it is absent outside of [begin, end).

    The form is that of Z. Li et al., Spacetime Gaussian Feature Splatting (CVPR 2024), eq. 5 to 8,
    with an interval for motions that need several pieces. All in float64 on the CPU.
    """

    center: Float[Tensor, " n"]
    """Time of the values of ``content``; usually in [0, 1], as all times, never far from it."""
    width: Float[Tensor, " n"]
    """Time in which the opacity falls to 1/e; infinity for a constant one."""
    begin: Float[Tensor, " n"]
    """First time of presence; minus infinity for none."""
    end: Float[Tensor, " n"]
    """Time at which the presence ends; infinity for none."""
    path: Float[Tensor, "n 3 3"]
    """Velocity, and the coefficients of d^2 and d^3, in the units of the means: [n, power, xyz]."""
    spin: Float[Tensor, "n 4"]
    """Change of the unit quaternion for each unit of time."""
    growth: Float[Tensor, "n 3"]
    """Change of the logarithms of the scales for each unit of time."""

    @staticmethod
    def none(count: int) -> Motion:
        """No motion of ``count`` splats that are always present."""
        zeros = torch.zeros(count, dtype=torch.float64)
        never, vectors = torch.full_like(zeros, torch.inf), zeros[:, None]
        return Motion(
            center=zeros,
            width=never,
            begin=-never,
            end=never,
            path=vectors[..., None].expand(-1, 3, 3),
            spin=vectors.expand(-1, 4),
            growth=vectors.expand(-1, 3),
        )

    def take(self, rows: Bool[Tensor, " n"] | Int[Tensor, " r"]) -> Motion:
        """The motion of some of the splats, in the order of ``rows``."""
        return Motion(*(getattr(self, field.name)[rows] for field in fields(self)))

    @staticmethod
    def cat(parts: Sequence[Motion]) -> Motion:
        """The motion of the splats of several parts, one after the other."""
        columns = ([getattr(part, field.name) for part in parts] for field in fields(Motion))
        return Motion(*(torch.cat(column) for column in columns))


@dataclass(frozen=True)
class Preview:
    """First sight of a scene on a page: views to begin with, and an image while it loads."""

    title: str
    views: Cameras
    """A few pinhole cameras worth looking from, in the world of the data; the first one opens the
    page."""
    target: Float[Tensor, " 3"]
    """The point to turn around first, in that world."""
    image: Float[Tensor, "h w 3"] | None = None
    """The first view, rendered; ``None`` for none."""
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Colour behind the splats, in [0, 1]."""


@dataclass(frozen=True)
class MotionFile(ExportSource):
    """Splats of a moving model for files, each with its motion in closed form."""

    content: SplatFile
    """The splats at each one's own centre of time."""
    motion: Motion
    time_range: tuple[float, float] | None = None
    """First and last time in the data's own unit; ``None`` for splats at rest."""
    frames: int = 1
    """Number of distinct times of the data; for players."""

    @property
    def is_still(self) -> bool:
        """True if nothing moves."""
        return self.time_range is None

    @property
    def has_pieces(self) -> bool:
        """True if any splat is present in an interval only."""
        return bool((self.motion.begin.isfinite() | self.motion.end.isfinite()).any())

    def motion_file(self, *, pieces: bool = True) -> MotionFile:
        """The file itself.

        Raises:
            ValueError: it is in pieces, which are not wanted.
        """
        if self.has_pieces and not pieces:
            raise ValueError("its splats are present in intervals, in pieces of their motion")
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
class DepthView:
    """A view of a model, rendered with depth, on the CPU."""

    camera: Cameras
    """One pinhole camera, in the world of the data, in float64."""
    color: Float[Tensor, "h w 3"]
    """In [0, 1]."""
    depth: Float[Tensor, "h w"]
    """Mean distance along the view axis, in units of the data; 0 where there is nothing."""
    alpha: Float[Tensor, "h w"]
    """Coverage, in [0, 1]."""
    up: str = ""
    """Up direction in the data's world; empty when unknown."""


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
    pitches: Float[Tensor, " n"] | None = None
    """Distance of the positions that a compressed file distinguishes, for each row, in scene units.
    ``None``: by the sizes of the rows; files do not hold it."""

    def stored_model(self) -> StoredModel:
        """The model itself."""
        return self


class Holds(Enum):
    """Content of one file of a format."""

    SPLATS = "splats at one time"
    MOTION = "splats at all times"
    DEPTHS = "depth images of the views"
    TRACKS = "paths of all Gaussians over time"
    MODEL = "the whole model"


class Exporter(ABC):
    """Writer of one file format.

    An exporter with options is a dataclass: each field is one, ``format.FIELD=VALUE``, and its
    docstring is the help. Wrong values raise a ``ConfigError`` in ``__post_init__``.
    """

    suffix: ClassVar[str]
    """Suffix of file names, with the dot, such as ".compressed.ply"; may be empty for a folder."""
    is_folder: ClassVar[bool] = False
    """True if the format is a folder of files."""
    is_readable: ClassVar[bool] = True
    """False if no importer can make splats of the files, such as points."""
    holds: ClassVar[Holds] = Holds.SPLATS
    """Content of a file; the exporter reads only this from its source."""
    other_suffixes: ClassVar[tuple[str, ...]] = ()
    """Further suffixes of file names that the format may have, such as ".obj"."""
    levels: ClassVar[tuple[Mapping[str, Any], ...]] = ()
    """Options of smaller files, whose cost ``gsfw tradeoff`` measures beside that of the usual."""

    @property
    def most_sh_degree(self) -> int:
        """Highest SH degree that a file holds; bands above it are left out."""
        return MAX_DEGREE

    @abstractmethod
    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically, by rows if the format lets it (``atomic_file``).

        A folder is created if it is missing; its index, which names the other files, comes last.

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
        """Read the file; rows that are not finite are dropped, and counted.

        Reserves no more memory than the size of the file justifies.

        Raises:
            DataError: it is damaged or not of this format; names the cause and the place.
        """

    def read_motion(self, path: Path) -> MotionFile:
        """Read the file: its splats at all times; at rest in formats that hold one time.

        Raises:
            DataError: it is damaged or not of this format; names the cause and the place.
        """
        return self.read(path).motion_file()

    def size(self, path: Path) -> int:
        """Bytes of the file or folder, with the files beside it that belong to it.

        Raises:
            DataError: it is damaged or not of this format; names the cause and the place.
        """
        return bytes_of(path)
