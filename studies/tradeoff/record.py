"""Record: the measurements of a variant, and the file that keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import mean, median

from gsfw.studies.json_store import JsonStore, Keyed

ADVICE = "Move it away to measure anew."

VariantKey = tuple[str, str]
"""Axis and name of a variant."""


@dataclass(frozen=True)
class Record(Keyed):
    """The measurements of a variant; plain data."""

    axis: str
    name: str
    per_view: list[dict[str, float]]
    """Metrics of each view by name; empty where the variant cannot be rendered."""
    relative_l2: float | None
    """Relative L2 error of its images against the unchanged model in float64; ``None`` where it
    cannot be rendered."""
    max_error: float | None
    """Largest difference of a colour in the same images."""
    num_gaussians: int
    floats: int
    """Stored numbers."""
    parameter_bytes: int
    """Bytes of these numbers in the variant's precision."""
    file_bytes: int | None = None
    """Bytes of the file that ``command`` writes; ``None`` for none."""
    file: str = ""
    """Format of that file."""
    command: list[str] = field(default_factory=list)
    """Verb and settings that do the same to a run; empty where no verb does."""
    draws_alike: bool = False
    """True if rendering takes the same time and memory as rendering the unchanged model."""
    readings: list[float] = field(default_factory=list)
    """Milliseconds to render a view, of each round."""
    flip: float | None = None
    """Mean of FLIP over some of the views; ``None`` where it is not known."""
    peak_memory_mb: float | None = None
    """Peak memory of rendering a view in megabytes, beyond the memory held before; ``None`` where
    it is not known."""
    failure: str = ""
    """The reason why the variant cannot be rendered; empty if it can."""

    @property
    def key(self) -> VariantKey:
        """Axis and name."""
        return self.axis, self.name

    @property
    def means(self) -> Mapping[str, float]:
        """Mean of each metric over the views."""
        names = self.per_view[0] if self.per_view else ()
        return {name: mean(figures[name] for figures in self.per_view) for name in names}

    @property
    def psnr(self) -> float | None:
        """Mean over the views, in dB; ``None`` where the variant cannot be rendered."""
        return self.means.get("psnr")

    @property
    def size(self) -> int:
        """Bytes of the file of a format; else those of the parameters in their precision."""
        if self.axis == "format" and self.file_bytes is not None:
            return self.file_bytes
        return self.parameter_bytes

    @property
    def ms(self) -> float | None:
        """Median time to render a view; ``None`` before any."""
        return median(self.readings) if self.readings else None

    @property
    def ms_spread(self) -> float | None:
        """Distance of the quartiles over the rounds; ``None`` before the second round."""
        if len(self.readings) < 2:
            return None
        ordered, last = sorted(self.readings), len(self.readings) - 1
        return ordered[round(0.75 * last)] - ordered[round(0.25 * last)]


class RecordStore(JsonStore[Record]):
    """The records of the variants of one model."""

    def __init__(self, path: Path, fingerprint: str, clock: str = "") -> None:
        """Read the file where it exists; records of other measurements are dropped.

        Args:
            path: of the file.
            fingerprint: identifies everything that accuracy depends on.
            clock: identifies everything else that times and memory depend on; where only this
                differs, times and memory alone are dropped.

        Raises:
            DataError: the file is damaged, or a newer gsfw has written it.
        """
        head = {"fingerprint": fingerprint, "clock": clock}
        super().__init__(path, {"records": Record}, head, ADVICE)
        self.forgotten = 0
        """Number of dropped records."""
        if self.stored and self.stored.get("fingerprint") != fingerprint:
            self.forgotten = len(self.records)
            self.records.clear()
        elif self.stored.get("clock", clock) != clock:
            for key, record in self.records.items():
                self.records[key] = replace(record, readings=[], peak_memory_mb=None)

    def add_round(self, readings: Mapping[VariantKey, float]) -> None:
        """Add the times of a round, in milliseconds.

        Raises:
            OutputError: the file cannot be written.
        """
        for key, reading in readings.items():
            known = self.records[key]
            self.records[key] = replace(known, readings=[*known.readings, reading])
        self.write()
