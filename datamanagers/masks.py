"""Masks: files that say which pixels of an image count, beside the images of any format."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8

from gsfw.core.batch import MaskMode
from gsfw.core.config import AUTO
from gsfw.core.errors import DataError
from gsfw.core.words import counted, listed
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.images import DecodedImage, load_mask
from gsfw.datamanagers.mask_folder import MaskFolder

FOLDER = "masks"
"""Default folder of masks."""

NONE, ALPHA = "none", "alpha"
"""Values of ``datamanager.masks`` that are no folder, besides ``auto``."""

Folders = dict[Path, MaskFolder]
"""Folders that were searched, each listed once."""

HALF = 127
"""Alpha above it is inside, where alpha is a mask."""


@dataclass(frozen=True)
class MaskRule:
    """The masks of a data set, and their meaning."""

    source: str = AUTO
    """auto (as the format's file names them, or in ``masks``), none, alpha, or a folder."""
    mode: MaskMode = MaskMode.IGNORE
    inverted: bool = False
    """True if masks are bright where pixels do not count."""

    def load(self, frame: Frame) -> Bool[np.ndarray, "h w"] | None:
        """True where an image's pixels count, by its file; ``None`` when it has none.

        Raises:
            DataError: the mask does not decode, or its size is not the image's.
        """
        if frame.mask is None:
            return None
        return load_mask(frame.mask, frame.path, frame.header) ^ self.inverted

    def apply(
        self, pixels: UInt8[np.ndarray, "h w d"], inside: Bool[np.ndarray, "h w"] | None
    ) -> tuple[UInt8[np.ndarray, "h w e"], Bool[np.ndarray, "h w"] | None]:
        """Colours and valid pixels of a decoded image.

        What lies outside an ``empty`` mask becomes transparent, as in an image with alpha: so its
        edges are mixed as colours are when it shrinks, and the blank borders of undistorted
        images still carry no loss.
        """
        if self.source == ALPHA and pixels.shape[2] == 4:
            inside = (pixels[..., 3] > HALF) ^ self.inverted
            pixels = pixels[..., :3]
        if inside is None or self.mode is MaskMode.IGNORE:
            return pixels, inside
        alpha = pixels[..., 3] if pixels.shape[2] == 4 else np.full(inside.shape, 255, np.uint8)
        covered = np.where(inside, alpha, 0).astype(np.uint8)
        return np.concatenate([pixels[..., :3], covered[..., None]], axis=2), None

    def inside(self, frame: Frame, image: DecodedImage) -> Bool[np.ndarray, "h w"] | None:
        """True where a fitted image's pixels lie wholly inside its mask; ``None``: all do."""
        masked = frame.mask is not None or (self.source == ALPHA and frame.header.has_alpha)
        if self.mode is MaskMode.IGNORE or not masked:
            return image.mask
        whole = np.asarray(image.pixels[..., 3] == 255)
        return whole if image.mask is None else whole & image.mask

    def gives_alpha(self, frame: Frame) -> bool:
        """True if a loaded image has alpha."""
        has_alpha, is_mask = frame.header.has_alpha, self.source == ALPHA
        if self.mode is MaskMode.EMPTY:
            return has_alpha or frame.mask is not None
        return has_alpha and not is_mask

    def gives_mask(self, frame: Frame) -> bool:
        """True if a loaded image has pixels that may carry no loss."""
        if self.mode is MaskMode.EMPTY:
            return False
        return frame.mask is not None or (self.source == ALPHA and frame.header.has_alpha)


USUAL_MASKS = MaskRule()
"""The masks that are used by default."""


def find_masks(
    recording: Recording, frames: Sequence[Frame], rule: MaskRule
) -> tuple[list[Frame], tuple[str, ...]]:
    """The frames with their masks, and what the user should know of them.

    Raises:
        DataError: the named folder is missing, contains no mask of any image, a mask is damaged or
            of another size than its image, or every image is masked out as a whole.
    """
    if rule.source == ALPHA:
        return _alpha_as_mask(recording, frames, rule)
    if rule.source == NONE:
        return [replace(frame, mask=None) for frame in frames], ()
    folders: Folders = {}
    found = [_with_mask(frame, recording, rule, folders) for frame in frames]
    masked = [frame for frame in found if frame.mask is not None]
    if masked:
        return found, _notes(found, masked, rule)
    return found, _none_found(recording, rule)


def _alpha_as_mask(
    recording: Recording, frames: Sequence[Frame], rule: MaskRule
) -> tuple[list[Frame], tuple[str, ...]]:
    bare = [replace(frame, mask=None) for frame in frames]
    count = sum(frame.header.has_alpha for frame in frames)
    if not count:
        raise DataError(
            f"datamanager.masks={ALPHA}: none of the {len(frames)} images of {recording.path} "
            "has alpha.",
            "Give a folder of masks (datamanager.masks=DIR), or leave datamanager.masks out.",
        )
    return bare, (f"alpha of {count} of {len(frames)} images is their mask: {_meaning(rule)}",)


def _with_mask(frame: Frame, recording: Recording, rule: MaskRule, folders: Folders) -> Frame:
    """The frame with the first mask that is there; what its file names comes before a guess."""
    if frame.mask is not None and rule.source == AUTO:
        return frame
    for path in _places(frame, recording, rule):
        # Files that mark moving pixels may lie in the folder of masks.
        found = folders.setdefault(path, MaskFolder(path)).find(frame.short_names, frame.moving)
        if found is not None:
            return replace(frame, mask=found)
    return replace(frame, mask=None)


def _places(frame: Frame, recording: Recording, rule: MaskRule) -> list[Path]:
    """Folders to search for a frame's mask: the named one, or masks beside the images' folder."""
    root = recording.root
    if rule.source != AUTO:
        return [root / rule.source]
    folders = [root / FOLDER]
    if frame.path.as_posix().endswith(f"/{frame.name}"):
        base = frame.path.parents[len(Path(frame.name).parts) - 1]
        folders += [base / FOLDER] + [base.parent / FOLDER] * base.name.startswith("images")
    return folders


@dataclass(frozen=True)
class StrayMasks:
    """Masks that belong to no image, while images have none."""

    files: tuple[Path, ...]
    bare: tuple[str, ...]
    """Names of the images without a mask, relative to their folder."""

    @property
    def looked_for(self) -> str:
        """Names that a mask of the first of these images may have."""
        name = Path(self.bare[0])
        return f"{name}.png or {name.with_suffix('.png')}"

    @property
    def found(self) -> str:
        """The first names that there are instead."""
        return listed([file.name for file in self.files], 3)


def stray_masks(recording: Recording, rule: MaskRule) -> StrayMasks | None:
    """Masks that no image has; ``None`` where each is used, or each image has one."""
    if rule.source in (ALPHA, NONE):
        return None
    folders: Folders = {}
    frames = [_with_mask(frame, recording, rule, folders) for frame in recording.frames]
    bare = tuple(str(frame.short_names[-1]) for frame in frames if frame.mask is None)
    used = {file for frame in frames for file in (frame.mask, frame.moving)}
    files = (path / file for path, folder in folders.items() for file in folder.files)
    stray = tuple(sorted({file for file in files if file not in used}))
    return StrayMasks(stray, bare) if stray and bare else None


def _none_found(recording: Recording, rule: MaskRule) -> tuple[str, ...]:
    """A note on a folder of masks that belongs to no image; an error where it was asked for."""
    folder = recording.root / (FOLDER if rule.source == AUTO else rule.source)
    if not folder.is_dir():
        if rule.source == AUTO:
            return ()
        raise DataError(
            f"datamanager.masks={rule.source}: there is no folder {folder}.",
            "Give the folder of the masks, relative to the data set.",
        )
    stray = stray_masks(recording, rule)
    problem = f"{folder} contains no mask of any image"
    if stray is not None:
        problem += f" (looked for {stray.looked_for}, in any image format; found {stray.found})"
    if rule.source == AUTO:
        return (f"{problem}: all pixels count",)
    raise DataError(
        f"{problem}.", "Name masks as their images, with .png behind or instead of the extension."
    )


def _notes(frames: Sequence[Frame], masked: Sequence[Frame], rule: MaskRule) -> tuple[str, ...]:
    """Notes on masks: their number, the kept part of the pixels, and masks that keep nothing.

    Raises:
        DataError: no mask leaves anything, or one cannot be used.
    """
    with ThreadPoolExecutor() as threads:
        parts = list(threads.map(lambda frame: _part_inside(frame, rule), masked))
    mean = 100 * sum(parts) / len(parts)
    notes = [
        f"{len(masked)} of {len(frames)} images have masks, which keep {mean:.0f} % of their "
        f"pixels: {_meaning(rule)}"
    ]
    hidden = [frame for frame, part in zip(masked, parts, strict=True) if part == 0]
    if len(hidden) == len(frames):
        raise DataError(
            f"the masks of all {len(frames)} images mask out every pixel, {hidden[0].mask} for "
            "one.",
            "Masks are bright where pixels count; if these are dark there, add "
            f"datamanager.invert_masks={'false' if rule.inverted else 'true'}.",
        )
    if hidden:
        names = listed([frame.name for frame in hidden])
        notes.append(
            f"masks hide {counted(len(hidden), 'image')} completely, and no figure includes "
            f"{'it' if len(hidden) == 1 else 'them'}: {names}"
        )
    if len(masked) < len(frames):
        bare = [frame.name for frame in frames if frame.mask is None]
        notes.append(f"no mask, so that all pixels count: {len(bare)} images, such as {bare[0]}")
    return tuple(notes)


def _part_inside(frame: Frame, rule: MaskRule) -> float:
    """Part of an image that its mask keeps, from 0 to 1."""
    inside = rule.load(frame)
    assert inside is not None
    return float(inside.mean())


def _meaning(rule: MaskRule) -> str:
    if rule.mode is MaskMode.EMPTY:
        return "pixels outside of the masks are background (datamanager.mask_mode=empty)"
    return "pixels outside of the masks have no loss (datamanager.mask_mode=ignore)"
