"""Painter: what draws a picture and finds its way back, for backends that are made of kernels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from torch import Tensor

from gsfw.core.rasterizer import StageTime

POSE_FIELDS = 15
"""Entries of a pose's gradient: by rotation [3, 3], by translation [3], by the camera centre [3],
on which the direction of spherical harmonics depends."""

Arrays = Mapping[str, Tensor | None]
"""Contiguous tensors by name; ``None`` for what is absent."""

Numbers = Mapping[str, float | int | bool]
"""Plain numbers by name."""


class TooManyPairs(Exception):
    """A picture was not drawn: it has more pairs of a splat and a tile than it may."""

    def __init__(self, count: int) -> None:
        super().__init__(f"{count} pairs of a splat and a tile")
        self.count = count


class Picture(ABC):
    """What one camera saw, kept for the way back."""

    @abstractmethod
    def backward(self, gradients: Mapping[str, Tensor | bool | None]) -> None:
        """Write the gradients of the inputs, and the statistics that come with them.

        Args:
            gradients: ``drawn``, the image as it was drawn, and of it ``image`` [h, w, d] and
                ``alpha`` [h, w]; then where results go: each of ``drawing.ROWS``, ``pose``
                [POSE_FIELDS], ``screen_gradient`` [n] and ``absgrad`` [n]; and whether the
                gradients are added to (``accumulate``) instead of replaced.
        """

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage, over all threads and by the clock on the wall."""
        return {}


class Painter(ABC):
    """The kernels of one backend."""

    name: str
    """Of the rasterizer, for messages."""
    most_pairs: int
    """Pairs of a splat and a tile that can be numbered."""

    @abstractmethod
    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per pair, with its share of what the backward pass needs."""

    @abstractmethod
    def paint(self, arrays: Arrays, numbers: Numbers, outputs: Arrays) -> Picture:
        """Draw one picture.

        Args:
            arrays: the tensors of ``drawing.INPUTS``, colours in flat rows, with this camera's
                world_to_camera [4, 4], intrinsics [3, 3], pixel_weights [h, w] and the background
                [d]; where rest is ragged [m, 3], the ``offsets`` [n + 1] of its rows.
            numbers: as ``request.request_of`` has them.
            outputs: what is written: image [h, w, d], alpha [h, w], visible [n], radii [n], and
                contribution [n] if asked for.

        Raises:
            TooManyPairs: there are more than ``numbers["most_pairs"]``.
        """


class StageLog(dict[str, StageTime]):
    """What the stages of the latest call took, summed over its cameras."""

    def record(self, pictures: Sequence[Picture]) -> None:
        """Read the clocks of some pictures, replacing what was read before."""
        self.clear()
        for picture in pictures:
            for name, (cpu, wall) in picture.times().items():
                before = self.get(name, StageTime(0.0, 0.0))
                self[name] = StageTime(before.cpu_ms + cpu, before.wall_ms + wall)
