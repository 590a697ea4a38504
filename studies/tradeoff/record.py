"""Record: what was measured of a variant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from statistics import mean, median
from typing import Any


@dataclass(frozen=True)
class Record:
    """What was measured of a variant; plain data."""

    axis: str
    name: str
    per_view: list[dict[str, float]]
    """Figures of each view, by metric; empty where it cannot be drawn."""
    relative_l2: float | None
    """From the model as it is, drawn in float64; ``None`` where it cannot be drawn."""
    max_error: float | None
    """Largest difference of a colour, of the same pictures."""
    num_gaussians: int
    floats: int
    """Numbers that it stores."""
    parameter_bytes: int
    """That they take in the variant's precision."""
    file_bytes: int | None = None
    """Of the file that ``command`` writes; ``None`` for none."""
    file: str = ""
    """Format of that file."""
    command: list[str] = field(default_factory=list)
    """Verb and settings that do the same to a run; empty where no verb does."""
    draws_alike: bool = False
    """Whether the time of the model as it is holds for it too."""
    readings: list[float] = field(default_factory=list)
    """Milliseconds to draw a view, of each round."""
    flip: float | None = None
    """Mean of FLIP over some of the views; ``None`` where it is not known."""
    peak_memory_mb: float | None = None
    """That drawing a view takes at most, in megabytes beyond what is held before; ``None`` where
    it is not known."""
    failure: str = ""
    """Why it cannot be drawn; empty where it can."""

    @property
    def key(self) -> tuple[str, str]:
        """Axis and name."""
        return self.axis, self.name

    @property
    def means(self) -> Mapping[str, float]:
        """Mean of each metric over the views."""
        names = self.per_view[0] if self.per_view else ()
        return {name: mean(figures[name] for figures in self.per_view) for name in names}

    @property
    def psnr(self) -> float | None:
        """Mean over the views, in dB; ``None`` where it cannot be drawn."""
        return self.means.get("psnr")

    @property
    def size(self) -> int:
        """Bytes by which variants are compared.

        Those of the file of a format, else those of the parameters in their precision.
        """
        if self.axis == "format" and self.file_bytes is not None:
            return self.file_bytes
        return self.parameter_bytes

    @property
    def ms(self) -> float | None:
        """Median time to draw a view; ``None`` before any."""
        return median(self.readings) if self.readings else None

    @property
    def ms_spread(self) -> float | None:
        """Between the quartiles of the rounds; ``None`` before the second."""
        if len(self.readings) < 2:
            return None
        ordered, last = sorted(self.readings), len(self.readings) - 1
        return ordered[round(0.75 * last)] - ordered[round(0.25 * last)]

    def document(self) -> dict[str, Any]:
        """What is kept."""
        return asdict(self)
