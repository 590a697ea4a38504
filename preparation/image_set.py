"""ImageSet: the photos or frames that a data set is made of, and what was left out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gsfw.datamanagers.images import Header
from gsfw.preparation.exif import Exif
from gsfw.preparation.panorama import Kind


@dataclass(frozen=True)
class ViewOfPanorama:
    """The place of a view in the panorama that it was cut from."""

    panorama: str
    """Name of the panorama; all of its views follow each other in a set."""
    number: int
    """Position of its direction in ``panorama_views.DIRECTIONS``."""
    focal: float
    """Focal length in pixels, which is known exactly."""


@dataclass(frozen=True)
class SourceImage:
    """One photo, or one frame of a video that was written to a file."""

    name: str
    """Unique; its path below images/ in the result, with forward slashes."""
    path: Path
    header: Header
    """Header of the upright image."""
    exif: Exif
    """EXIF data of the file; empty for frames of videos."""
    group: str = ""
    """The folder or the video it comes from; empty where there is only one."""
    time: float | None = None
    """Seconds from the first frame of its video; ``None`` for photos."""
    said: Kind | None = None
    """The kind that the metadata of its video tell; ``None`` for none, and for photos."""
    view: ViewOfPanorama | None = None
    """``None`` for an image that a camera has taken."""
    mask: Path | None = None
    """An image of the same size that is bright where pixels count; ``None`` where all do."""

    @property
    def shot(self) -> str:
        """Equal for images that one camera took at once: the views of a panorama."""
        return self.name if self.view is None else f"/{self.view.panorama}"


@dataclass(frozen=True)
class LeftOut:
    """A file that is not used, and why."""

    name: str
    reason: str
    """A short clause, such as "the file is empty (0 bytes)"."""
    advice: str = ""
    """Remedy; empty where nothing needs to be done."""


@dataclass(frozen=True)
class ImageSet:
    """All images, sorted by name in the order of the numbers in it; none is there twice."""

    images: tuple[SourceImage, ...]
    left_out: tuple[LeftOut, ...] = ()
    in_order: bool = False
    """True if images of a group follow each other in time, as the frames of a video do."""

    @cached_property
    def by_name(self) -> Mapping[str, SourceImage]:
        """Images by their names."""
        return {image.name: image for image in self.images}

    def whole_shots(self, names: Collection[str]) -> set[str]:
        """The names whose shots are complete: all images of the shot are in ``names``."""
        others = {image.shot for image in self.images if image.name not in names}
        return {name for name in names if self.by_name[name].shot not in others}

    @cached_property
    def groups(self) -> Mapping[str, tuple[SourceImage, ...]]:
        """Images by their groups, both in order."""
        names = dict.fromkeys(image.group for image in self.images)
        return {
            name: tuple(image for image in self.images if image.group == name) for name in names
        }
