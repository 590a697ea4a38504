"""RunComparison: figures and settings of runs side by side, and whether they can be compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from gsfw.core.words import duration, metric_name, size
from gsfw.reports.plain_text import metric_text, plain
from gsfw.reports.run_record import RunRecord

PARTS = ("method", "preset", "strategy", "rasterizer", "datamanager", "sampler")
"""Settings whose values have settings of their own."""

CHOICES = (*PARTS, "data", "device", "steps", "seed", "downscale")
"""Settings that are shown wherever they differ; of the others those that a user chose."""


PSNR_MARGIN, SSIM_MARGIN = 0.05, 0.001
"""Chosen: nobody sees such differences, and another seed makes them."""

COUNT_MARGIN, MACHINE_MARGIN = 0.01, 0.1
"""Chosen, as parts of the value: times of the same run differ by as much."""


@dataclass(frozen=True)
class Figure:
    """A figure of a run, as a row of a table."""

    key: str
    name: str
    text: Callable[[float], str]
    better: int = 0
    """1 where more is better, -1 where less is, 0 where neither is, or nobody knows."""
    margin: float = 0.0
    """Difference up to which two values are as good as each other."""
    is_relative: bool = False
    """True if ``margin`` is a part of the value."""
    is_of_machine: bool = False
    """True if it depends on the machine."""

    def value(self, record: RunRecord) -> float | None:
        """The figure of a run; ``None`` if it is not known."""
        found = record.figure(self.key)
        return record.baseline(self.key) if found is None else found

    def best(self, values: Sequence[float | None]) -> list[bool]:
        """Values that are the best, or as good; none if one is unknown, or if all are as good."""
        known = [value for value in values if value is not None]
        if self.better == 0 or len(known) < len(values):
            return [False] * len(values)
        top = max(known, key=lambda value: self.better * value)
        margin = self.margin * (abs(top) if self.is_relative else 1.0)
        found = [abs(value - top) <= margin for value in known]
        return found if not all(found) else [False] * len(values)


def _cost(key: str, name: str, text: Callable[[float], str]) -> Figure:
    """A number that is the better the lower it is."""
    return Figure(key, name, text, -1, COUNT_MARGIN, is_relative=True)


def _other(name: str) -> Figure:
    """A metric without a row of its own; that of a plugin has a better side if it is a PSNR."""
    is_psnr = name.endswith("psnr")
    text = partial(metric_text, name)
    return Figure(name, metric_name(name), text, int(is_psnr), PSNR_MARGIN if is_psnr else 0.0)


def _measured(key: str, name: str, text: Callable[[float], str]) -> Figure:
    """A time or an amount of memory."""
    return Figure(key, name, text, -1, MACHINE_MARGIN, is_relative=True, is_of_machine=True)


QUALITY = (
    Figure("psnr", "PSNR", "{:.2f} dB".format, 1, PSNR_MARGIN),
    Figure("ssim", "SSIM", "{:.4f}".format, 1, SSIM_MARGIN),
    Figure("moving_psnr", "PSNR of the moving region", "{:.2f} dB".format, 1, PSNR_MARGIN),
    Figure("moving_ssim", "SSIM of the moving region", "{:.4f}".format, 1, SSIM_MARGIN),
)
COST = (
    Figure("training_psnr", "PSNR of training views", "{:.2f} dB".format),
    Figure("constant_psnr", "PSNR of one colour", "{:.2f} dB".format),
    _cost("num_gaussians", "Gaussians", "{:,.0f}".format),
    _cost("model_bytes", "model", size),
    _measured("train_seconds", "training", duration),
    _measured("render_ms", "to render an image", "{:.1f} ms".format),
    _measured("peak_memory_mb", "memory", lambda mb: size(1e6 * mb)),
    _measured("peak_gpu_memory_mb", "memory of the GPU", lambda mb: size(1e6 * mb)),
)
"""Rows of the table; all other metrics stand between the two."""


@dataclass(frozen=True)
class RunComparison:
    """Two or more runs side by side; every row has a value for each run."""

    records: tuple[RunRecord, ...]

    @cached_property
    def figures(self) -> dict[Figure, list[float | None]]:
        """Figures that some run has."""
        known = {figure.key for figure in QUALITY}
        names = dict.fromkeys(name for record in self.records for name in record.metrics)
        others = [_other(name) for name in names if name not in known]
        rows = {
            figure: [figure.value(record) for record in self.records]
            for figure in (*QUALITY, *others, *COST)
        }
        return {f: values for f, values in rows.items() if any(v is not None for v in values)}

    @cached_property
    def settings(self) -> dict[str, list[Any]]:
        """Settings that differ; ``None`` where a run has no such setting.

        The pace of a planned run is left out: it says what a machine did, and nobody chose it.
        """
        found = _differing([record.settings for record in self.records])
        is_planned = any("pace" in record.planned for record in self.records)
        return {key: values for key, values in found.items() if key != "pace" or not is_planned}

    @property
    def chosen(self) -> list[str]:
        """Settings that differ because somebody chose so; the others follow from these."""
        given = frozenset[str]().union(*(record.given for record in self.records))
        return [key for key in self.settings if key in CHOICES or key in given]

    @property
    def following(self) -> list[str]:
        """Settings that differ because others do."""
        chosen = set(self.chosen)
        return [key for key in self.settings if key not in chosen]

    @property
    def added(self) -> dict[str, list[int]]:
        """Settings that only some runs have, though all have the same parts; with their places.

        A plugin got or lost such a setting between the runs.
        """
        if any(key in PARTS for key in self.settings):
            return {}
        found = {
            key: [place for place, record in enumerate(self.records) if key in record.settings]
            for key in self.following
        }
        return {key: places for key, places in found.items() if len(places) < len(self.records)}

    @property
    def plugins(self) -> list[str]:
        """The packages of each run's plugins, with their versions; empty if all have the same."""
        found = [
            ", ".join(map(str, record.header.get("plugins") or ())) or "none"
            for record in self.records
        ]
        return found if len(set(found)) > 1 else []

    @cached_property
    def protocol(self) -> dict[str, list[Any]]:
        """Differences in how the figures of the evaluated runs were measured, and of what.

        A rule that only some runs name is no difference: it is of a metric that others lack.
        """
        measured = [record for record in self.records if record.protocol]
        rules = [{"data": record.data, **record.protocol} for record in measured]
        shared = [key for key in (rules or [{}])[0] if all(key in rule for rule in rules)]
        return _differing([{key: rule[key] for key in shared} for rule in rules])

    def why_not(self, names: Sequence[str]) -> list[str]:
        """Reasons why no run is better than another, as sentences; empty if they compare.

        Args:
            names: of the runs, for the sentences.
        """
        measured = [n for n, r in zip(names, self.records, strict=True) if r.protocol]
        # On different data all else is different too.
        keys = ["data"] if "data" in self.protocol else list(self.protocol)
        reasons = [
            f"The figures were not measured alike: {key.replace('_', ' ')} "
            f"{_by_value(self.protocol[key], measured)}."
            for key in keys
        ]
        for name, record in zip(names, self.records, strict=True):
            if not record.is_finished:
                reasons.append(
                    f"{name} is not finished: its figures are those after "
                    f"{record.steps_done:,} steps."
                )
            elif not record.protocol:
                reasons.append(f"{name} was not evaluated.")
        return reasons

    @cached_property
    def is_comparable(self) -> bool:
        """True if all runs are finished, and were measured alike on the same data."""
        return not self.why_not([record.name for record in self.records])

    @cached_property
    def is_same_machine(self) -> bool:
        """True if all runs are known to be of equal machines; reads their checkpoints."""
        found = [record.environment for record in self.records]
        return bool(found[0]) and all(environment == found[0] for environment in found)

    def best(self, figure: Figure) -> list[bool]:
        """Runs that have the best value of a row; none where the row cannot be compared."""
        values = self.figures[figure]
        if not self.is_comparable or (figure.is_of_machine and not self.is_same_machine):
            return [False] * len(values)
        return figure.best(values)

    def document(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {
            "runs": [record.document() for record in self.records],
            "settings": self.settings,
            "chosen": self.chosen,
            "figures": {figure.key: values for figure, values in self.figures.items()},
            "protocol": self.protocol,
        }


def _by_value(values: Sequence[Any], names: Sequence[str]) -> str:
    """Values, each with the runs that have it: "7 in one and two, 9 in three"."""
    runs: dict[str, list[str]] = {}
    for value, name in zip(values, names, strict=True):
        runs.setdefault(plain(value), []).append(name)
    return ", ".join(f"{value} in {' and '.join(found)}" for value, found in runs.items())


def _differing(documents: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The keys whose values are not the same everywhere, with the value of each document."""
    keys = dict.fromkeys(key for document in documents for key in document)
    found = {key: [document.get(key) for document in documents] for key in keys}
    return {key: values for key, values in found.items() if any(v != values[0] for v in values)}
