"""Painter over the native kernels of the CPU."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from gsfw.kernels.cpu.native_module import native
from gsfw.kernels.cpu.threads import num_threads
from gsfw.rasterizers.painter import Arrays, Numbers, Painter, Picture, TooManyPairs


class CpuPainter(Painter):
    """Draws with every core."""

    name = "cpu"
    most_pairs = 2**32 - 1

    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per pair: as it is found, as it is sorted, and its sums in the backward pass."""
        module = _native()
        return module.PAIR_BYTES + (module.SLOT_FIELDS + channels) * element_size

    def paint(self, arrays: Arrays, numbers: Numbers, outputs: Arrays) -> Picture:
        """Draw one picture."""
        module = _native()
        image = outputs["image"]
        assert image is not None
        kind = module.DrawingFloat32 if image.dtype == torch.float32 else module.DrawingFloat64
        try:
            return CpuPicture(kind(arrays, {**numbers, "threads": num_threads()}, outputs))
        except module.TooManyPairs as refused:
            raise TooManyPairs(refused.args[0]) from None


class CpuPicture(Picture):
    """A native picture."""

    def __init__(self, drawing: Any) -> None:  # noqa: ANN401 - of one type or the other.
        self._drawing = drawing

    def backward(self, gradients: Mapping[str, Tensor | bool | None]) -> None:
        """Write the gradients of the inputs."""
        self._drawing.backward(gradients)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage, over all threads and by the clock on the wall."""
        return self._drawing.times()


def _native() -> Any:  # noqa: ANN401
    module = native()
    assert module is not None, "the capabilities say that there is none"
    return module
