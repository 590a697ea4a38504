"""Error image: the difference of a render and its photo in colours, as FLIP or as it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, UInt8

from gsfw.core.color_bytes import color_bytes
from gsfw.core.errors import UnavailableError
from gsfw.core.maths.flip import flip_map, unavailable
from gsfw.rendering.color_maps import colored

ErrorKind = Literal["auto", "flip", "absolute"]

GAIN = 4.0
"""Factor of absolute errors: a quarter of the range of colours is as bright as it gets."""


@dataclass(frozen=True)
class ErrorImage:
    """One way to show errors."""

    is_flip: bool

    @property
    def words(self) -> str:
        """Meaning of the colours."""
        if self.is_flip:
            return "FLIP at the size shown, black 0 (no visible difference) to yellow 1"
        return f"absolute error, mean of the channels, black 0 to yellow {1 / GAIN:g}"

    def draw(
        self, rendered: UInt8[np.ndarray, "h w 3"], target: UInt8[np.ndarray, "h w 3"]
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The error of each pixel as a colour."""
        if self.is_flip:
            shown, photo = (
                torch.from_numpy(image / np.float32(255)) for image in (rendered, target)
            )
            values = flip_map(shown, photo)[..., 0].numpy()
        else:
            difference = rendered.astype(np.float32) - target.astype(np.float32)
            values = GAIN * np.abs(difference).mean(-1) / 255
        return in_colors(values)


def choose_error(kind: ErrorKind) -> ErrorImage:
    """FLIP where its package is installed, or what was asked for.

    Raises:
        UnavailableError: FLIP was asked for, and its package is not there.
    """
    why = unavailable()
    if kind == "flip" and why:
        raise UnavailableError(f"error=flip: {why}.", "error=absolute needs nothing more.")
    return ErrorImage(kind == "flip" or (kind == "auto" and not why))


def in_colors(values: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Values in [0, 1] in the colours of FLIP's paper, magma; dark grey where not finite."""
    colors = colored(torch.from_numpy(values.astype(np.float32)), 0.0, 1.0, "magma")
    pixels: np.ndarray = color_bytes(colors).numpy()
    return pixels
