"""Kernel backend: the contract of rasterizers that are made of native kernels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from gsfw.core.rasterizer import StageTime
from gsfw.kernels.render_arguments import (
    KernelGradients,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
)


class TooManyPairs(Exception):
    """An image has more tile intersections (pairs of a splat and a tile) than it may have."""

    def __init__(self, count: int) -> None:
        super().__init__(f"{count} pairs of a splat and a tile")
        self.count = count


class ForwardPass(ABC):
    """The finished forward pass of one camera, kept for its backward pass."""

    @abstractmethod
    def backward(self, gradients: KernelGradients) -> None:
        """Write the gradients of the inputs, and the gradient statistics."""

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage: summed over all threads, and by the wall clock."""
        return {}


class KernelBackend(ABC):
    """The kernels of one rasterizer."""

    name: str
    """Name of the rasterizer, for messages."""
    max_pairs: int
    """Most tile intersections that the kernels can number."""

    @abstractmethod
    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per tile intersection, including its share of the backward pass."""

    @abstractmethod
    def render(
        self, inputs: KernelInputs, settings: KernelSettings, outputs: KernelOutputs
    ) -> ForwardPass:
        """Render one image.

        Raises:
            TooManyPairs: it has more than ``settings.max_pairs`` tile intersections.
        """


class StageLog(dict[str, StageTime]):
    """Times of the stages of the latest call, summed over its cameras."""

    def record(self, passes: Sequence[ForwardPass]) -> None:
        """Replace the times by those of ``passes``."""
        self.clear()
        for one in passes:
            for name, (cpu, wall) in one.times().items():
                before = self.get(name, StageTime(0.0, 0.0))
                self[name] = StageTime(before.cpu_ms + cpu, before.wall_ms + wall)
