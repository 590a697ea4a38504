"""Painter over the CUDA kernels."""

from __future__ import annotations

from gsfw.kernels.cuda.instances import WIDTHS
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.rasterizers.cuda.picture import SUM_CHANNELS, CudaPicture
from gsfw.rasterizers.cuda.stage_clock import StageClock
from gsfw.rasterizers.painter import Arrays, Numbers, Painter, Picture

MOST_CHANNELS = WIDTHS[-1]
"""Channels drawn at once, those of extra and depth included."""

SORTED_BYTES = 16
"""Memory per pair while it is sorted: two tiles and two payloads."""

CHECKPOINT_PIXELS = 2
"""Pixels' states per pair: 256 of them are kept for every 128 pairs."""


class CudaPainter(Painter):
    """Draws through a launcher."""

    name = "cuda"
    most_pairs = 2**31 - 1

    def __init__(self, launcher: Launcher, deterministic: bool, measuring: bool) -> None:
        self._launcher = launcher
        self._deterministic = deterministic
        self._measuring = measuring

    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per pair: while it is sorted, its checkpoints, and its sums if it has its own."""
        numbers = CHECKPOINT_PIXELS * (1 + channels)
        slot = 4 + (SUM_CHANNELS + channels) * element_size if self._deterministic else 0
        return SORTED_BYTES + numbers * element_size + slot

    def paint(self, arrays: Arrays, numbers: Numbers, outputs: Arrays) -> Picture:
        """Draw one picture.

        Raises:
            ValueError: it has more channels than can be drawn at once.
        """
        background = arrays["background"]
        assert background is not None
        if len(background) > MOST_CHANNELS:
            raise ValueError(
                f"splats: expected at most {MOST_CHANNELS} channels with those of extra and depth, "
                f"found {len(background)}; draw them in several passes"
            )
        clock = StageClock(self._measuring)
        return CudaPicture(self._launcher, clock, self._deterministic, arrays, numbers, outputs)
