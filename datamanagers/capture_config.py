"""CaptureConfig: the settings of every format whose images were taken by cameras."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, final

from gsfw.core.batch import MaskMode
from gsfw.core.config import AUTO, DataManagerConfig
from gsfw.core.datamanager import DataRequest
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.frames import Recording, data_path
from gsfw.datamanagers.masks import MaskRule
from gsfw.datamanagers.undistortion import LensRule
from gsfw.datamanagers.view_maps import MapFolder

WIDEST = 160.0
"""Degrees; at the border of such a pinhole image a degree is 33 times as wide as inside."""


@dataclass(kw_only=True)
class CaptureConfig(DataManagerConfig, ABC):
    """Settings of every format whose images were taken by cameras: lenses, masks, per-view maps.

    A format derives from it (``@dataclass(kw_only=True)``), adds its own settings, and implements
    ``detect`` and ``recording``. Images of pinholes stay as they are.
    """

    own_maps: ClassVar[frozenset[str]] = frozenset()
    """Names of the per-view maps that data sets of this format may have, without ``maps``."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "mask_mode": "masks!=none",
        "invert_masks": "masks!=none",
    }

    fisheye: str = "undistort"
    """Images of fisheye lenses: undistort (to a pinhole), or keep (to an ideal fisheye)."""
    field_of_view: float = 120.0
    """Most degrees, across and down, that an image undistorted to a pinhole shows."""
    blank_pixels: float = number(0.0, at_least=0, at_most=1)
    """0: undistorted images are cut to what the lens saw; 1: all it saw, the rest masked."""
    masks: str = AUTO
    """Masks, bright where pixels count: auto (as the data set names them, or PNG in masks/), none,
    alpha (of the images), or a folder."""
    mask_mode: str = MaskMode.IGNORE.value
    """Pixels outside masks: ignore (they carry no loss), or empty (they show the background)."""
    invert_masks: bool = False
    """True if masks are dark where pixels count."""
    colors: str = "srgb"
    """Colours of photos and videos: srgb (converted to it by their colour profiles, and from HDR),
    or stored (the numbers of the files, as benchmarks with published figures read them)."""
    maps: tuple[str, ...] = ()
    """Per-view maps (features, labels, depth) for methods: NAME:FOLDER[:RULE[:UNIT]], several with
    commas. RULE: mean, nearest or depth. Files (.npy [h, w, d], images) are named like the images.
    """

    @abstractmethod
    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the data set's files and the headers of its images.

        Args:
            path: the ``data`` key; it exists.
            downscale: factor that images will be shrunk by, for formats that store smaller ones
                (see ``Recording.shrunk``).

        Raises:
            ConfigError: a setting of the format is out of range.
            DataError: a file is missing or damaged.
        """

    @final
    def build(self, request: DataRequest) -> Capture:
        """Read the recording, and make of it what the run asks for.

        Raises:
            ConfigError: a setting is out of range.
            DataError: the data cannot be used; says where and why.
        """
        rules = self.lens_rule(), self.mask_rule(), self.map_folders(), self.as_stored()
        recording = self.recording(data_path(request.path), request.downscale)
        remaining = max(1.0, request.downscale / recording.shrunk)
        return Capture(recording, replace(request, downscale=remaining), *rules)

    def map_folders(self) -> tuple[MapFolder, ...]:
        """The folders of per-view maps.

        Raises:
            ConfigError: one is not written as it has to be, or a name is used twice.
        """
        folders = tuple(MapFolder.parse(text) for text in self.maps)
        names = [folder.name for folder in folders]
        if len(set(names)) < len(names):
            raise ConfigError(
                f"datamanager.maps={','.join(self.maps)}: a name is used twice.",
                "Give every map a name of its own.",
            )
        return folders

    def as_stored(self) -> bool:
        """True if photos keep their numbers, whatever their colour profiles say.

        Raises:
            ConfigError: the setting is neither of its values.
        """
        if self.colors not in ("srgb", "stored"):
            raise ConfigError(f"datamanager.colors={self.colors}: expected srgb or stored.")
        return self.colors == "stored"

    def lens_rule(self) -> LensRule:
        """Treatment of images of distorted lenses.

        Raises:
            ConfigError: a setting is out of range.
        """
        if self.fisheye not in ("undistort", "keep"):
            raise ConfigError(f"datamanager.fisheye={self.fisheye}: expected undistort or keep.")
        if not 0 < self.field_of_view <= WIDEST:
            raise ConfigError(
                f"datamanager.field_of_view={self.field_of_view:g}: expected degrees up to "
                f"{WIDEST:g}.",
                "datamanager.fisheye=keep shows more of a fisheye lens.",
            )
        return LensRule(self.fisheye == "keep", self.blank_pixels, self.field_of_view)

    def mask_rule(self) -> MaskRule:
        """The masks of the data set, and their meaning.

        Raises:
            ConfigError: the mode is none of those.
        """
        modes = [mode.value for mode in MaskMode]
        if self.mask_mode not in modes:
            raise ConfigError(
                f"datamanager.mask_mode={self.mask_mode}: expected {' or '.join(modes)}."
            )
        return MaskRule(self.masks or AUTO, MaskMode(self.mask_mode), self.invert_masks)
