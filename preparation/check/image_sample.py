"""ImageSample: measurements of a decoded sample of the images of a capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from gsfw.core.batch import Batch
from gsfw.core.color_bytes import color_bytes
from gsfw.core.datamanager import DataManager
from gsfw.core.errors import DataError
from gsfw.core.loop.area import shrink_batch
from gsfw.core.progress import tracked
from gsfw.datamanagers.capture import Capture
from gsfw.preparation.check.small_images import load_small, size_at_most
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.image_quality import MEASURED_SIDE, ImageQuality

PREVIEW_SIDE = 400
"""Longest side of the preview of each image, in pixels."""
PRINT = 16
"""Side of the grey thumbnails that images are compared by, in pixels."""
BORDER = 0.02
"""The border of an image is this part of its sides wide, and at least a pixel."""
PLAIN = 8 / 255
"""Colours within this are one: JPEG moves a white background by about so much."""
PLAIN_PART = 0.3
"""A background shows in this part of the border at least: of garden_robot_mv's images, whose
garden reaches three of their sides, in 0.34 to 0.66 of it."""


@dataclass(frozen=True)
class SampledImage:
    """One decoded image."""

    view: int
    """Index among the viewpoints."""
    pixels: UInt8[np.ndarray, "h w 3"]
    """The preview: small; over white where it has alpha. There may be hundreds of them."""
    print: Float[np.ndarray, "q q"]
    """Smaller still, and grey."""
    quality: ImageQuality
    """Quality of the pixels that count."""
    contrast: float
    """Standard deviation of all valid pixels."""
    border: str
    """White or black where a good part of the border is; else empty."""
    valid: float
    """Part of its pixels that carries loss."""
    covered: float
    """Mean coverage; 1 for opaque images."""

    @property
    def preview(self) -> Float[np.ndarray, "h w 3"]:
        """The preview, in [0, 1]."""
        return self.pixels / 255.0


@dataclass(frozen=True)
class ImageSample:
    """Decoded images spread over a capture, and those that do not decode."""

    images: tuple[SampledImage, ...]
    failures: tuple[tuple[int, str], ...]
    """View and message of each image that does not decode."""
    total: int
    """Images of the capture."""

    @property
    def tried(self) -> int:
        """Images that were to be decoded."""
        return len(self.images) + len(self.failures)

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints, count: int) -> ImageSample:
        """Decode ``count`` images, spread evenly over cameras and times; 0: all."""
        longest = min(MEASURED_SIDE, int(viewpoints.sizes.max(1).min()))
        images: list[SampledImage] = []
        failures: list[tuple[int, str]] = []
        views = spread_views(viewpoints, count)
        for view in tracked(views, "looking at images", len(views)):
            split, number = viewpoints.splits[view], viewpoints.numbers[view]
            stored = viewpoints.sizes[view]
            width, height = size_at_most(int(stored[0]), int(stored[1]), longest)
            try:
                batch = load_small(data, split, number, width, height)
            except DataError as error:
                failures.append((view, error.message))
                continue
            images.append(_measured(view, batch))
        return ImageSample(tuple(images), tuple(failures), len(viewpoints))


def spread_views(viewpoints: Viewpoints, count: int) -> Sequence[int]:
    """Views spread evenly over cameras, and for each over its times."""
    total = len(viewpoints)
    times = viewpoints.times if viewpoints.times is not None else np.arange(total)
    order = np.lexsort((times, viewpoints.physical))
    count = min(count, total) or total
    chosen = order[np.unique(np.linspace(0, total - 1, count).round().astype(int))]
    return [int(view) for view in chosen]


def _at_most(batch: Batch, longest: int) -> Batch:
    height, width = batch.images.shape[1:3]
    return shrink_batch(batch, *size_at_most(width, height, longest))


def _measured(view: int, batch: Batch) -> SampledImage:
    shown = batch.target(torch.ones(3))[0].numpy().astype(np.float64)
    height, width = shown.shape[:2]
    coverage = np.ones((height, width))
    if batch.coverage is not None:
        coverage = batch.coverage[0, ..., 0].numpy().astype(np.float64)
    valid = np.ones((height, width), bool)
    if batch.valid is not None:
        valid = batch.valid[0, ..., 0].numpy()
    border = _plain_border(shown, valid & (coverage > 0.5))
    counts = valid & (coverage > 0.5) & ~_background(shown, border)
    counts = counts if counts.any() else valid
    grey = shown.mean(2)
    small = _at_most(batch, PREVIEW_SIDE)
    rows, columns = small.images.shape[1:3]
    square = shrink_batch(small, min(PRINT, columns), min(PRINT, rows))
    return SampledImage(
        view=view,
        pixels=color_bytes(small.target(torch.ones(3))[0]).numpy(),
        print=square.target(torch.ones(3))[0].numpy().mean(2).astype(np.float64),
        quality=ImageQuality.of(shown, counts),
        contrast=float(grey[valid].std()) if valid.any() else 0.0,
        border=border,
        valid=float(valid.mean()),
        covered=float(coverage.mean()),
    )


def _plain_border(shown: Float[np.ndarray, "h w 3"], counts: Bool[np.ndarray, "h w"]) -> str:
    """White or black where that is the colour of a good part of the border, as far as it counts."""
    height, width = shown.shape[:2]
    band = max(1, round(BORDER * min(width, height)))
    ring = counts.copy()
    ring[band:-band, band:-band] = False
    if not ring.any():
        return ""
    for name, value in (("white", 1.0), ("black", 0.0)):
        if (np.abs(shown[ring] - value).max(1) <= PLAIN).mean() >= PLAIN_PART:
            return name
    return ""


def _background(shown: Float[np.ndarray, "h w 3"], border: str) -> Bool[np.ndarray, "h w"]:
    """True for pixels of the border's plain colour."""
    if not border:
        return np.zeros(shown.shape[:2], bool)
    value = 1.0 if border == "white" else 0.0
    return np.asarray(np.abs(shown - value).max(2) <= PLAIN)


@dataclass(frozen=True)
class Files:
    """Counts over all images."""

    turned: tuple[str, ...] = ()
    """Names of images with an EXIF orientation, which was applied."""
    in_videos: int = 0
    """Images that are decoded from videos."""

    @staticmethod
    def of(data: DataManager) -> Files:
        """The files of a data set; nothing where its images are no files."""
        if not isinstance(data, Capture):
            return Files()
        frames = data.recording.frames
        return Files(
            turned=tuple(frame.name for frame in frames if frame.header.orientation != 1),
            in_videos=sum(frame.shot is not None for frame in frames),
        )
