"""FrameTask: one image of a data set that is converted, with the files that belong to it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import UInt8

from gsfw.core.batch import LEAST_KNOWN
from gsfw.datamanagers.fitted_map import ImageFit
from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.images import Header, decode, fit_mask, load_mask
from gsfw.datamanagers.map_file import DEPTH, MapFile
from gsfw.datamanagers.masks import MaskRule
from gsfw.datamanagers.warp import MapCache, Warp
from gsfw.preparation.image_file import unique_names, with_right_suffix
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.image_output import ImageChange, StoredImage, encoded_mask
from gsfw.preparation.writing.written_files import IMAGES, MASKS

MOVING, DEPTHS = "motion_masks", "depths"
"""Folders of the written files, besides those of every data set."""


@dataclass(frozen=True)
class FrameTask:
    """The output files of a frame."""

    frame: Frame
    change: ImageChange
    masks: MaskRule
    files: dict[str, str]
    """Names of the files that are written, relative to the data set, by their folders."""
    pixels: UInt8[np.ndarray, "h w 3"] | None = None
    """Pixels of an image of a video, once it is decoded."""

    @property
    def sources(self) -> list[Path]:
        """The files that are read."""
        frame = self.frame
        depth = self._depth_file
        others = (frame.mask, frame.moving, None if depth is None else depth.path)
        return [frame.path, *(path for path in others if path is not None)]

    @property
    def _depth_file(self) -> MapFile | None:
        return self.frame.maps.get(DEPTH)

    def made(self, maps: MapCache, quality: int) -> dict[str, bytes]:
        """The content of each file, by its name.

        Raises:
            DataError: the image, a mask or the depths do not decode or do not fit.
        """
        warp = self.change.warp(maps)
        content = {IMAGES: self.change.content(self._decode, warp, quality)}
        if MASKS in self.files:
            content[MASKS] = self._mask(warp)
        if MOVING in self.files:
            content[MOVING] = self._moving(warp)
        if DEPTHS in self.files:
            content[DEPTHS] = self._depth(warp)
        return {self.files[folder]: data for folder, data in content.items()}

    def written_frame(self, out: Path) -> Frame:
        """The frame of the written files below ``out``."""
        paths = {folder: out / name for folder, name in self.files.items()}
        target, depth = self.change.plan.target, self._depth_file
        return replace(
            self.frame,
            name=self.files[IMAGES],
            path=paths[IMAGES],
            header=Header(target.width, target.height, self.frame.header.has_alpha),
            lens=target,
            mask=paths.get(MASKS),
            moving=paths.get(MOVING),
            shot=None,
            maps={}
            if depth is None or DEPTHS not in paths
            else {DEPTH: replace(depth, path=paths[DEPTHS])},
        )

    def _decode(self) -> UInt8[np.ndarray, "h w d"]:
        return decode(self.frame.path, self.frame.header) if self.pixels is None else self.pixels

    def _mask(self, warp: Warp | None) -> bytes:
        target = self.change.plan.target
        inside = fit_mask(self.masks.load(self.frame), target.width, target.height, warp)
        assert inside is not None
        return encoded_mask(inside)

    def _moving(self, warp: Warp | None) -> bytes:
        frame, target = self.frame, self.change.plan.target
        assert frame.moving is not None
        still = ~load_mask(frame.moving, frame.path, frame.header)
        # If any of the source pixels moves, their mean does.
        fitted = fit_mask(still, target.width, target.height, warp)
        assert fitted is not None
        return encoded_mask(~fitted)

    def _depth(self, warp: Warp | None) -> bytes:
        """The file as it is, or undistorted numbers in the same unit."""
        depth, header = self._depth_file, self.frame.header
        assert depth is not None
        if warp is None:
            return depth.path.read_bytes()
        depth.header(header)
        target = self.change.plan.target
        fit = ImageFit((header.width, header.height), (target.width, target.height), warp)
        depths, part = fit.resample(replace(depth, unit=1.0).read(), depth.rule)
        buffer = io.BytesIO()
        np.save(buffer, np.where(part >= LEAST_KNOWN, depths, 0)[..., 0])
        return buffer.getvalue()


def tasks_of(
    frames: Sequence[Frame], masks: MaskRule, keep: bool, with_depth: bool
) -> list[FrameTask]:
    """One for each frame.

    Args:
        frames: with the masks that were found.
        masks: what masks mean.
        keep: whether lenses stay as they are.
        with_depth: whether the layout holds depths, and masks of what moves.

    Raises:
        DataError: a lens cannot be undistorted.
    """
    changes = [_change(frame, keep) for frame in frames]
    names = unique_names(
        with_right_suffix(_plain(frame.name), change.format)
        for frame, change in zip(frames, changes, strict=True)
    )
    return [
        FrameTask(frame, change, masks, _files(frame, change, name, with_depth))
        for frame, change, name in zip(frames, changes, names, strict=True)
    ]


def _change(frame: Frame, keep: bool) -> ImageChange:
    header = frame.header
    plan = CameraPlan.of(frame.lens.resized(header.width, header.height), keep)
    stored = None if frame.shot is not None else StoredImage.read(frame.path, header)
    return ImageChange(stored, plan)


def _files(frame: Frame, change: ImageChange, name: str, with_depth: bool) -> dict[str, str]:
    """The output files of a frame, by folder."""
    undistortion = change.plan.undistortion
    files = {IMAGES: f"{IMAGES}/{name}"}
    if frame.mask is not None or (undistortion is not None and undistortion.has_blanks):
        files[MASKS] = f"{MASKS}/{name}.png"
    if with_depth and frame.moving is not None:
        files[MOVING] = f"{MOVING}/{name}.png"
    if with_depth and (depth := frame.maps.get(DEPTH)) is not None:
        suffix = depth.path.suffix if undistortion is None else ".npy"
        files[DEPTHS] = f"{DEPTHS}/{name}{suffix}"
    return files


def _plain(name: str) -> str:
    """A frame's name as a path below images/."""
    parts = [
        part
        for part in PurePosixPath(name.replace("\\", "/")).parts
        if part not in ("/", "..") and not part.endswith(":")
    ]
    if len(parts) > 1 and parts[0] == IMAGES:
        parts = parts[1:]
    return "/".join(parts)
