"""FittedMap: a per-view map that lies over an undistorted and shrunk image.

Maps that have fewer pixels than the image, such as features at an eighth of its size, keep their
own resolution until a batch needs them: this saves memory, and transfers to a GPU. Larger ones are
shrunk to the size of the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor
from torch.nn.functional import interpolate

from gsfw.core.batch import LEAST_KNOWN, Resampling
from gsfw.datamanagers.area import pick_nearest, shrink_values
from gsfw.datamanagers.warp import Warp

ROUNDING = 1e-4
"""Sums of weights are right to this much."""


@dataclass(frozen=True)
class ImageFit:
    """Fit of an image: its sizes in pixels, and its undistortion."""

    stored: tuple[int, int]
    """Width and height of the upright image file."""
    final: tuple[int, int]
    """Width and height of the undistorted and shrunk image."""
    warp: Warp | None = None
    """Undistorts it; ``None`` for images of pinholes."""

    def map_size(self, width: int, height: int) -> tuple[int, int]:
        """Size of the fitted map of one that is stored as ``width`` x ``height`` pixels."""
        straight = self._straight_size(width, height)
        return min(straight[0], self.final[0]), min(straight[1], self.final[1])

    def _straight_size(self, width: int, height: int) -> tuple[int, int]:
        """Size of an undistorted map before it is shrunk; pixels keep their size."""
        stored = self.stored
        target = self.warp.undistortion.target if self.warp is not None else None
        shown = stored if target is None else (target.width, target.height)
        return (
            max(1, round(shown[0] * min(width, stored[0]) / stored[0])),
            max(1, round(shown[1] * min(height, stored[1]) / stored[1])),
        )

    def resample(
        self, values: Float32[np.ndarray, "h w d"], rule: Resampling
    ) -> tuple[Float32[np.ndarray, "h2 w2 d"], Float32[np.ndarray, "h2 w2 1"]]:
        """A stored map, undistorted and shrunk to ``map_size``, and the known part of each pixel.

        Values are 0 where no part is known.
        """
        rows, columns = values.shape[:2]
        known = rule.known(torch.from_numpy(values)).numpy()
        weighted = np.concatenate([np.where(known, values, 0), known.astype(np.float32)], axis=2)
        width, height = self.stored
        weighted = _shrink(weighted, min(columns, width), min(rows, height), rule)
        if self.warp is not None:
            mode = "bilinear" if rule is Resampling.MEAN else "nearest"
            straight = self._straight_size(columns, rows)
            weighted = self.warp.numbers(weighted, *straight, mode)
        weighted = _shrink(weighted, *self.map_size(columns, rows), rule)
        part = weighted[..., -1:]
        return weighted[..., :-1] / np.where(part > 0, part, 1), part


@dataclass(frozen=True)
class FittedMap:
    """A per-view map over an image of [h, w]."""

    values: Float[np.ndarray, "rows columns d"]
    """At the map's own resolution where it is lower; float16 where the file is."""
    known: Bool[np.ndarray, "h w"]
    """True where the map is known, at the size of the image."""
    rule: Resampling

    @staticmethod
    def of(
        values: Float[np.ndarray, "rows columns d"],
        rule: Resampling,
        fit: ImageFit,
        inside: Bool[np.ndarray, "h w"] | None = None,
    ) -> FittedMap:
        """Fit the numbers of a file, some of which may be unknown by ``rule``.

        Args:
            values: cover the whole stored image.
            rule: of the map.
            fit: of its image.
            inside: True where the fitted image's pixels are inside its mask; ``None``: all.
        """
        fitted, part = fit.resample(values.astype(np.float32), rule)
        clear = torch.from_numpy((part > LEAST_KNOWN - ROUNDING).astype(np.float32))
        width, height = fit.final
        # An interpolated pixel is known if no unknown one contributes to it.
        known = enlarged(clear, rule, width, height).numpy()[..., 0] > 1 - ROUNDING
        if inside is not None:
            known &= inside
        return FittedMap(fitted.astype(values.dtype, copy=False), known, rule)

    @staticmethod
    def unknown(channels: int, rule: Resampling, width: int, height: int) -> FittedMap:
        """The map of a view for which nothing was measured."""
        nothing = np.zeros((height, width), bool)
        return FittedMap(np.zeros((1, 1, channels), np.float32), nothing, rule)


def enlarged(
    values: Float[Tensor, "rows columns d"], rule: Resampling, width: int, height: int
) -> Float[Tensor, "h w d"]:
    """A map at the size of its image, which is at least as large."""
    if values.shape[:2] == (height, width):
        return values
    mode = "bilinear" if rule is Resampling.MEAN else "nearest-exact"
    return interpolate(values.permute(2, 0, 1)[None], (height, width), mode=mode)[0].permute(
        1, 2, 0
    )


def _shrink(
    values: Float32[np.ndarray, "h w d"], width: int, height: int, rule: Resampling
) -> Float32[np.ndarray, "h2 w2 d"]:
    shrink = pick_nearest if rule is Resampling.NEAREST else shrink_values
    return shrink(values, width, height)
