"""Requirements: the floats of a finished model, the PSNR gain of each group, and unused parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

REQUIREMENTS_SCHEMA = 1
"""Version of the layout of ``requirements.json``; raised if its readers would misread it."""


@dataclass(frozen=True)
class FloatGroup:
    """Parameters that serve one purpose."""

    name: str
    floats: int
    bought_db: float | None
    """PSNR loss of the finished model without them, in dB; ``None`` when not measured."""
    how: str
    """The measurement, or the cause why there is none: a sentence."""


@dataclass(frozen=True)
class LeastUseful:
    """The Gaussians with the smallest contributions to the training views."""

    part: float
    """Fraction of all Gaussians, in (0, 1)."""
    contribution: float
    """Fraction of the sum of alpha times transmittance over all Gaussians, in [0, 1]."""
    bought_db: float
    """PSNR loss of the finished model without them, in dB."""


@dataclass(frozen=True)
class Motion:
    """PSNR gain of the model's change with time."""

    bought_db: float
    """PSNR loss of the finished model when every view is rendered at one time, in dB."""
    time: float
    """The time of these renders, in [0, 1]."""


@dataclass(frozen=True)
class Requirements:
    """Requirements of a scene; a float is a number of 4 bytes."""

    headline: str
    """The most important result in one line."""
    step: int
    num_gaussians: int
    groups: tuple[FloatGroup, ...]
    """All parameters that rendering needs."""
    sh_floats: int
    """Number of floats of spherical harmonics; 0 for colours of another kind."""
    sh_floats_full: int
    """Number of such floats if each Gaussian had the highest degree of the settings."""
    rows_by_degree: tuple[int, ...]
    """Number of Gaussians of each SH degree, from 0 on; empty without spherical harmonics."""
    training_floats: Mapping[str, int]
    """Floats of the training alone: the optimizer's moments, columns without an optimizer."""
    views: tuple[str, ...]
    """Names of the views with measured PSNR."""
    split: str
    """Split of these views: "eval" (held out), or "train" if none is held out."""
    protocol: str
    """Measurement protocol, in a sentence or two."""
    psnr: float
    """PSNR of the unchanged model on these views, in dB."""
    least_useful: tuple[LeastUseful, ...] = ()
    """Growing fractions; empty if contributions cannot be measured."""
    motion: Motion | None = None
    """``None`` for a static model."""
    num_times: int = 0
    """Number of captured times; 0 for a static capture."""
    left_out: tuple[str, ...] = ()
    """Parts that the model does not have, as sentences."""
    could_go: tuple[str, ...] = ()
    """Parts that the model hardly needs, and the settings that remove them, as sentences."""
    not_measured: tuple[str, ...] = ()
    """Missing measurements and their causes, as sentences."""
    strategy: Mapping[str, Any] = field(default_factory=dict)
    """The report of the density strategy."""
    method: Mapping[str, Any] = field(default_factory=dict)
    """The report of the method."""
    seconds: float = 0.0
    """Duration of the measurement."""

    @property
    def total_floats(self) -> int:
        """Number of floats that rendering needs."""
        return sum(group.floats for group in self.groups)

    @property
    def floats_per_time(self) -> float | None:
        """Mean number of floats of a captured time; ``None`` for a static capture."""
        return round(self.total_floats / self.num_times, 1) if self.num_times > 1 else None

    def document(self) -> dict[str, Any]:
        """Plain data for ``requirements.json``."""
        total = max(self.total_floats, 1)
        motion = self.motion and {"bought_db": self.motion.bought_db, "time": self.motion.time}
        return {
            "schema": REQUIREMENTS_SCHEMA,
            "headline": self.headline,
            "step": self.step,
            "num_gaussians": self.num_gaussians,
            "total_floats": self.total_floats,
            "floats_per_time": self.floats_per_time,
            "sh_floats": self.sh_floats,
            "sh_floats_full": self.sh_floats_full,
            "rows_by_sh_degree": list(self.rows_by_degree),
            "psnr": self.psnr,
            "measured": {
                "how": self.protocol,
                "split": self.split,
                "views": list(self.views),
                "seconds": round(self.seconds, 3),
            },
            "groups": [
                {
                    "name": group.name,
                    "floats": group.floats,
                    "share": group.floats / total,
                    "bought_db": group.bought_db,
                    "how": group.how,
                }
                for group in self.groups
            ],
            "least_useful": [
                {
                    "part": item.part,
                    "contribution": item.contribution,
                    "bought_db": item.bought_db,
                }
                for item in self.least_useful
            ],
            "motion": motion,
            "left_out": list(self.left_out),
            "could_go": list(self.could_go),
            "not_measured": list(self.not_measured),
            "training_floats": dict(self.training_floats),
            "strategy": dict(self.strategy),
            "method": dict(self.method),
        }
