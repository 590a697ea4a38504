"""Batch: images of one size and one time, with their cameras and per-view maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras

LEAST_KNOWN = 0.5
"""A resampled pixel is known if at least this fraction of its area is known."""

SEGMENTATION = "segmentation"
"""Name of the per-view map that tells foreground (1) from background (0)."""


class MaskMode(Enum):
    """Meaning of the pixels outside a mask."""

    IGNORE = "ignore"
    """They carry no loss; losses are normalised by the valid pixels."""
    EMPTY = "empty"
    """They show the background."""


class Resampling(Enum):
    """Rule that undistorts and resizes a per-view map, and marks its unknown values."""

    MEAN = "mean"
    """Linear interpolation, and area means of the known pixels: features, normals, confidence.
    Values that are not finite are unknown."""
    NEAREST = "nearest"
    """The nearest pixel; values are never mixed: labels. Values that are not finite are unknown."""
    DEPTH = "depth"
    """Nearest pixel where a map is undistorted or enlarged, area means of the known pixels where
    it shrinks. Lengths in scene units; values that are not finite and positive are unknown."""

    def known(self, values: Float[Tensor, "*size d"]) -> Bool[Tensor, "*size 1"]:
        """True where all channels of a pixel are known."""
        known = values.isfinite()
        if self is Resampling.DEPTH:
            known &= values > 0
        return known.all(dim=-1, keepdim=True)


@dataclass(frozen=True)
class ViewMap:
    """Measurements for each pixel of a batch's images, such as depths, features or labels."""

    values: Float[Tensor, "c h w d"]
    """0 where unknown. Depth is measured along the camera's axis (z), in scene units."""
    known: Bool[Tensor, "c h w 1"]
    """False where no value was measured, and outside masks."""
    rule: Resampling = Resampling.MEAN
    """Rule that resizes the map together with the images."""

    @staticmethod
    def of(values: Float[Tensor, "c h w d"], rule: Resampling = Resampling.MEAN) -> ViewMap:
        """A map of raw values, some of which may be unknown by ``rule``."""
        known = rule.known(values)
        return ViewMap(torch.where(known, values, 0.0), known, rule)

    def within(self, valid: Bool[Tensor, "c h w 1"]) -> ViewMap:
        """The same map, unknown where a pixel is not valid."""
        known = self.known & valid
        return replace(self, values=torch.where(known, self.values, 0.0), known=known)

    def mean(self, error: Float[Tensor, "c h w k"]) -> Float[Tensor, ""]:
        """The mean of a per-pixel error over the known pixels, for losses; 0 where there are none.

        ``error`` has to be finite everywhere.
        """
        weights = self.known.to(error.dtype)
        return (error * weights).sum() / (weights.sum() * error.shape[-1]).clamp(min=1)


@dataclass(frozen=True)
class Batch:
    """``c`` images of one size and one time."""

    images: Float[Tensor, "c h w 3"]
    """Colours as stored, in [0, 1]; straight (not multiplied by alpha)."""
    cameras: Cameras
    """One per image, at the size of the images."""
    views: tuple[int, ...]
    """Index of each image within its split."""
    alpha: Float[Tensor, "c h w 1"] | None = None
    """Coverage in [0, 1]; ``None`` when the images are opaque."""
    mask: Bool[Tensor, "c h w 1"] | None = None
    """True where a pixel is valid; ``None`` when all pixels are."""
    mask_mode: MaskMode = MaskMode.IGNORE
    """Meaning of the pixels outside the mask; ``valid`` and ``target`` follow it."""
    maps: Mapping[str, ViewMap] = field(default_factory=dict)
    """Per-view maps by name, at the size of the images; ``Views.maps`` names the same ones."""
    numbers: Int[Tensor, " c"] | None = None
    """``views`` on the device, in steps with trained corrections of the capture."""
    left_out: Bool[Tensor, "c h w 1"] | None = None
    """True for pixels of a distractor (``ignore_distractors=true``); ``None``: none is sought."""

    @property
    def time(self) -> Float[Tensor, ""] | None:
        """The batch's time in [0, 1]; ``None`` for a static capture."""
        return None if self.cameras.time is None else self.cameras.time[0]

    @property
    def valid(self) -> Bool[Tensor, "c h w 1"] | None:
        """True where a pixel carries loss; ``None`` when all pixels do."""
        masked = self.mask if self.mask_mode is MaskMode.IGNORE else None
        if self.left_out is None:
            return masked
        return ~self.left_out if masked is None else masked & ~self.left_out

    @property
    def coverage(self) -> Float[Tensor, "c h w 1"] | None:
        """Fraction of each pixel that is not background, in [0, 1]; ``None`` if it is always 1."""
        coverage = self.alpha
        if self.mask is not None and self.mask_mode is MaskMode.EMPTY:
            inside = self.mask.to(self.images.dtype)
            coverage = inside if coverage is None else coverage * inside
        return coverage

    def target(self, background: Float[Tensor, " 3"]) -> Float[Tensor, "c h w 3"]:
        """Composite the images over a background colour: the target of a render."""
        coverage = self.coverage
        if coverage is None:
            return self.images
        return self.images * coverage + background * (1.0 - coverage)
