"""Batch: some pictures of one size and one time, with their cameras."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras


class MaskMode(Enum):
    """What the pixels outside a mask mean."""

    IGNORE = "ignore"
    """They carry no loss; losses are normalised by the valid pixels."""
    EMPTY = "empty"
    """They show the background."""


@dataclass(frozen=True)
class Batch:
    """``c`` pictures of one size and one time."""

    images: Float[Tensor, "c h w 3"]
    """Colours as stored, in [0, 1]; straight (not multiplied by alpha)."""
    cameras: Cameras
    views: tuple[int, ...]
    """Index of each picture within its split."""
    alpha: Float[Tensor, "c h w 1"] | None = None
    """Coverage in [0, 1]; ``None`` when the images are opaque."""
    mask: Bool[Tensor, "c h w 1"] | None = None
    """True where a pixel is valid; ``None`` when all are."""
    mask_mode: MaskMode = MaskMode.IGNORE
    weight: float = 1.0
    """Factor of this batch's loss (importance sampling); 1 when views are drawn uniformly."""
    depth: Float[Tensor, "c h w 1"] | None = None
    """Measured depth in scene units, 0 where unknown; ``None`` when there is none."""

    @property
    def time(self) -> Float[Tensor, ""] | None:
        """The batch's time in [0, 1]; ``None`` for a static capture."""
        return None if self.cameras.time is None else self.cameras.time[0]

    @property
    def valid(self) -> Bool[Tensor, "c h w 1"] | None:
        """True where a pixel carries loss; ``None`` when all do."""
        return self.mask if self.mask_mode is MaskMode.IGNORE else None

    @property
    def coverage(self) -> Float[Tensor, "c h w 1"] | None:
        """What part of a pixel is not background, in [0, 1]; ``None`` when all of all pixels is."""
        coverage = self.alpha
        if self.mask is not None and self.mask_mode is MaskMode.EMPTY:
            inside = self.mask.to(self.images.dtype)
            coverage = inside if coverage is None else coverage * inside
        return coverage

    def target(self, background: Float[Tensor, " 3"]) -> Float[Tensor, "c h w 3"]:
        """The pictures over a background colour: what a render should look like."""
        coverage = self.coverage
        if coverage is None:
            return self.images
        return self.images * coverage + background * (1.0 - coverage)
