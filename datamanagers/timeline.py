"""Timeline: capture times of a whole data set, normalised to [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame


@dataclass(frozen=True)
class Timeline:
    """Begin and end of a data set."""

    range: tuple[float, float] | None = None
    """First and last time in the data's own unit; ``None`` for a static capture."""
    count: int = 0
    """Distinct times; 0 for a static capture."""

    @staticmethod
    def of(frames: Sequence[Frame], unused_times: Sequence[float] = ()) -> Timeline:
        """The timeline over all splits; a data set that shows a single instant is static.

        Raises:
            DataError: some frames have a time and some do not.
        """
        timeless = [frame for frame in frames if frame.time is None]
        if len(timeless) == len(frames):
            return Timeline()
        if timeless:
            raise DataError(
                f"{timeless[0].name} has no time, but {len(frames) - len(timeless)} of "
                f"{len(frames)} frames have one.",
                "Give every frame its time, or none.",
            )
        times = {*unused_times, *(frame.time for frame in frames if frame.time is not None)}
        if len(times) < 2:
            return Timeline()
        return Timeline((min(times), max(times)), len(times))

    def at(self, time: float | None) -> float | None:
        """A time of the data, as (t - t_min) / (t_max - t_min); ``None`` for a static capture."""
        if time is None or self.range is None:
            return None
        first, last = self.range
        return (time - first) / (last - first)

    def all_at(self, times: Float64[Tensor, " p"] | None) -> Float[Tensor, " p"] | None:
        """Times of points, likewise; points outside the range count as seen at its end."""
        if times is None or self.range is None:
            return None
        first, last = self.range
        return ((times - first) / (last - first)).clamp(0.0, 1.0).float()
