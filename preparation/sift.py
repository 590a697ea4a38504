"""Features of one image, found in a process of its own: SIFT (Lowe 2004) by COLMAP."""

from __future__ import annotations

import signal
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from gsfw.core.errors import DataError
from gsfw.datamanagers.area import shrink, shrink_mask
from gsfw.datamanagers.images import Header, decode, load_mask
from gsfw.preparation.blur import direction_of_blur
from gsfw.preparation.cancellation import end_with_parent
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.native import load_colmap

if TYPE_CHECKING:
    from pycolmap import FeatureExtractor

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue in grey (ITU-R BT.601)."""
OPAQUE = 128
"""Alpha from which a pixel shows something."""
ERRORS = 2
"""COLMAP's name for errors: what a worker may say; it has no terminal of its own."""


@dataclass(frozen=True)
class ImageTask:
    """An image, and what is to be measured of it."""

    name: str
    path: Path
    header: Header
    size: int
    """Longest side on which features are looked for, in pixels."""
    count: int
    """Most features."""
    measured: int
    """Longest side on which sharpness is measured, in pixels: the same for all images."""
    enough: int
    """Features from which on the finest, those of the image at twice its size, are not looked
    for."""
    mask: Path | None = None
    """Bright where pixels count: there are no features elsewhere; ``None`` where all do."""


@dataclass(frozen=True)
class ImageFeatures:
    """Features and quality of an image."""

    name: str
    quality: ImageQuality
    blur: tuple[float, float]
    """Direction in degrees, and how much fine detail is left along it."""
    keypoints: Float32[np.ndarray, "n 6"]
    """x, y in pixels of the upright image at its full size, and the affine shape by rows."""
    descriptors: UInt8[np.ndarray, "n 128"]
    enlarged: bool = True
    """True if the finest features were looked for."""
    failure: str = ""
    """The reason why the image could not be decoded, then all else is empty; or nothing."""


def start_worker() -> None:
    """Leave Ctrl-C to the parent process, which ends its workers, and be silent."""
    load_colmap()
    from pycolmap import logging

    warnings.filterwarnings("ignore", module=r"PIL\b")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.minloglevel = ERRORS
    end_with_parent()


def find_features(task: ImageTask) -> ImageFeatures:
    """Decode an image, measure it, and find its features."""
    try:
        pixels = decode(task.path, task.header)
        inside = None if task.mask is None else load_mask(task.mask, task.path, task.header)
    except DataError as error:
        return _undecoded(task, error.message)
    expected = (task.header.height, task.header.width)
    if pixels.shape[:2] != expected:
        return _undecoded(task, f"{task.path}: the image was replaced while it was prepared.")
    shown, counts = _over_grey(_shrunk(pixels, task.measured))
    grey = shown @ LUMA
    if inside is not None:
        counts = counts & shrink_mask(inside, *counts.shape[::-1])
        inside = shrink_mask(inside, *_small(task))
    (keypoints, descriptors), enlarged = _sift(_shrunk(pixels, task.size), inside, task)
    across, down = (side / small for side, small in zip(expected[::-1], _small(task), strict=True))
    # Centres are at +0.5, so that positions and shapes scale about the image's corner.
    keypoints *= np.array([across, down, across, across, down, down], np.float32)
    return ImageFeatures(
        task.name,
        ImageQuality.of(shown, None if counts.all() else counts),
        direction_of_blur(grey),
        keypoints,
        descriptors,
        enlarged,
    )


def _sift(
    pixels: UInt8[np.ndarray, "h w d"], inside: Bool[np.ndarray, "h w"] | None, task: ImageTask
) -> tuple[tuple[Float32[np.ndarray, "n 6"], UInt8[np.ndarray, "n 128"]], bool]:
    """Features, and whether the image was enlarged for them."""
    if task.enough <= task.count:
        found = sift(pixels, task.count, enlarged=False, inside=inside)
        if len(found[0]) >= task.enough:
            return found, False
    return sift(pixels, task.count, inside=inside), True


def _undecoded(task: ImageTask, failure: str) -> ImageFeatures:
    nothing = ImageQuality(0.0, 0.0, 0.0, 0.0)
    keypoints, descriptors = np.zeros((0, 6), np.float32), np.zeros((0, 128), np.uint8)
    return ImageFeatures(task.name, nothing, (0.0, 1.0), keypoints, descriptors, failure=failure)


def _small(task: ImageTask) -> tuple[int, int]:
    return _fitted(task.header.width, task.header.height, task.size)


def _fitted(width: int, height: int, longest: int) -> tuple[int, int]:
    scale = min(1.0, longest / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def _shrunk(pixels: UInt8[np.ndarray, "h w d"], longest: int) -> UInt8[np.ndarray, "h2 w2 d"]:
    height, width = pixels.shape[:2]
    return shrink(pixels, *_fitted(width, height, longest))


def _over_grey(
    pixels: UInt8[np.ndarray, "h w d"],
) -> tuple[Float32[np.ndarray, "h w 3"], np.ndarray]:
    """Colours in [0, 1] over mid-grey, and where there is something."""
    colors = pixels[..., :3].astype(np.float32) / 255
    if pixels.shape[2] == 3:
        return colors, np.ones(pixels.shape[:2], bool)
    alpha = pixels[..., 3:].astype(np.float32) / 255
    return colors * alpha + 0.5 * (1 - alpha), pixels[..., 3] >= OPAQUE


def sift(
    pixels: UInt8[np.ndarray, "h w d"],
    count: int,
    enlarged: bool = True,
    inside: Bool[np.ndarray, "h w"] | None = None,
) -> tuple[Float32[np.ndarray, "n 6"], UInt8[np.ndarray, "n 128"]]:
    """Features of an image at the size that it has.

    Args:
        pixels: with or without alpha; features where nothing shows are left out.
        count: of features at most, those of the largest scale.
        enlarged: look for the finest features in the image at twice its size (Lowe 2004, section
            3.3), which takes four times as long.
        inside: features elsewhere are left out; ``None`` for all of the image.

    Returns:
        Keypoints (x, y in pixels, and the affine shape by rows) and descriptors.
    """
    shown, counts = _over_grey(pixels)
    grey = np.rint(shown @ LUMA * 255).astype(np.uint8)
    found, described = _extractor(count, max(grey.shape), enlarged).extract_from_uint8_array(grey)
    rows = [(p.x, p.y, p.a11, p.a12, p.a21, p.a22) for p in found]
    keypoints = np.array(rows, np.float32).reshape(-1, 6)
    descriptors = np.asarray(described.data, np.uint8).reshape(-1, 128)
    last = np.array(grey.shape[::-1]) - 1
    column, row = keypoints[:, :2].astype(int).clip(0, last).T
    kept = (counts if inside is None else counts & inside)[row, column]
    keypoints, descriptors = keypoints[kept], descriptors[kept]
    # COLMAP stops between levels of scale, and counts several orientations of a place as one.
    areas = np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4])
    largest = np.sort(np.argsort(-areas, kind="stable")[:count])
    return keypoints[largest], descriptors[largest]


def _extractor(count: int, longest: int, enlarged: bool) -> FeatureExtractor:
    """One for a single image.

    COLMAP's keeps a state: after an image with 3 features it found 598 where there were 1,691.
    """
    import pycolmap

    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.max_image_size = longest
    options.sift.max_num_features = count
    options.sift.first_octave = -1 if enlarged else 0
    return pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
