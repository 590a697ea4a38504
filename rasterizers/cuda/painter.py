"""Painter over the CUDA kernels."""

from __future__ import annotations

import torch

from gsfw.kernels.cuda.instances import WIDTHS, Instances
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.rasterizers.cuda.picture import (
    SUM_CHANNELS,
    CudaPicture,
    Equipment,
    instances_of,
    kernels_of,
)
from gsfw.rasterizers.cuda.stage_clock import StageClock
from gsfw.rasterizers.painter import Arrays, Numbers, Painter, Picture

MOST_CHANNELS = WIDTHS[-1]
"""Channels drawn at once, those of extra and depth included."""

SORTED_BYTES = 16
"""Memory per pair while it is sorted: two tiles and two payloads."""

TILE_PIXELS = 256
"""Pixels whose states are kept in front of every chunk of a tile's pairs."""


class CudaPainter(Painter):
    """Draws through a launcher."""

    name = "cuda"
    most_pairs = 2**31 - 1

    def __init__(self, launcher: Launcher, deterministic: bool, measuring: bool) -> None:
        self._launcher = launcher
        self._deterministic = deterministic
        self._measuring = measuring
        self._prepared: set[tuple[Instances, bool]] = set()

    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per pair: while it is sorted, its checkpoints, and its sums if it has its own."""
        dtype = torch.float64 if element_size == torch.float64.itemsize else torch.float32
        blended = Instances(dtype, False, -1, min(channels, MOST_CHANNELS), torch.int16)
        numbers = TILE_PIXELS // blended.chunk * (1 + blended.width)
        slot = 4 + (SUM_CHANNELS + channels) * element_size if self._deterministic else 0
        return SORTED_BYTES + numbers * element_size + slot

    def paint(self, arrays: Arrays, numbers: Numbers, outputs: Arrays) -> Picture:
        """Draw one picture.

        Raises:
            ValueError: it has more channels than can be drawn at once, or is elsewhere.
        """
        background = arrays["background"]
        assert background is not None
        if len(background) > MOST_CHANNELS:
            raise ValueError(
                f"splats: expected at most {MOST_CHANNELS} channels with those of extra and depth, "
                f"found {len(background)}; draw them in several passes"
            )
        if not self._launcher.reaches(background.device):
            raise ValueError(
                "splats.means: expected a tensor on the GPU that the rasterizer was built for, "
                f"found one on {background.device}"
            )
        chosen = instances_of(arrays, numbers)
        kind = (chosen, bool(numbers["differentiated"]))
        if kind not in self._prepared:
            self._launcher.prepare(kernels_of(*kind))
            self._prepared.add(kind)
        clock = StageClock(self._measuring, background.device)
        equipment = Equipment(self._launcher, clock, chosen, self._deterministic)
        return CudaPicture(equipment, arrays, numbers, outputs)
