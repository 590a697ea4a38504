"""Leftovers: files beside a capture's images that training would not use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.datamanager import DataManager
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.images import EXTENSIONS
from gsfw.datamanagers.masks import StrayMasks, stray_masks


@dataclass(frozen=True)
class Leftovers:
    """Nothing where a data set has no files."""

    photos: tuple[str, ...] = ()
    """Names of photos in the folders of the images that have no camera."""
    masks: StrayMasks | None = None
    """Masks of no image, while images have none."""

    @staticmethod
    def of(data: DataManager) -> Leftovers:
        """Look into the folders."""
        if not isinstance(data, Capture):
            return Leftovers()
        frames = data.recording.frames
        used = {frame.path for frame in frames}
        used |= {file for frame in frames for file in (frame.mask, frame.moving) if file}
        used |= {file.path for frame in frames for file in frame.maps.values()}
        folders = {frame.path.parent for frame in frames if frame.shot is None}
        kinds = {path.suffix for path in used}
        stems = {path.stem for path in used}
        photos = [
            file.name
            for folder in sorted(folders)
            for file in sorted(folder.iterdir())
            if file not in used
            and file.suffix in kinds
            and file.stem not in data.recording.left_out
            and not _derived(file, stems)
        ]
        return Leftovers(tuple(photos), stray_masks(data.recording, data.mask_rule))


def _derived(file: Path, stems: set[str]) -> bool:
    """True for what was computed from an image: NAME_depth.png, or NAME.jpg.png beside NAME.jpg."""
    if file.suffix.lower() not in EXTENSIONS:
        return True
    return any(
        file.stem[:end] in stems
        for end in range(1, len(file.stem) + 1)
        if end == len(file.stem) or not file.stem[end].isalnum()
    )
