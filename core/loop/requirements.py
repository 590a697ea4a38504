"""Requirements: where the floats of a finished model went, what each bought, what was left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

REQUIREMENTS_SCHEMA = 1
"""Number of the layout of ``requirements.json``; raised when its readers would be misled."""


@dataclass(frozen=True)
class FloatGroup:
    """Parameters that serve one purpose."""

    name: str
    floats: int
    bought_db: float | None
    """PSNR that the finished model loses without them, in dB; ``None`` when not measured."""
    how: str
    """How that was measured, or why it was not: a sentence."""


@dataclass(frozen=True)
class LeastUseful:
    """Those Gaussians that add the least to the training views."""

    part: float
    """Of all Gaussians, in (0, 1)."""
    contribution: float
    """Their part of what all add: of the sum of alpha times transmittance, in [0, 1]."""
    bought_db: float
    """PSNR that the finished model loses without them, in dB."""


@dataclass(frozen=True)
class Motion:
    """What it is worth that a model changes with time."""

    bought_db: float
    """PSNR that the finished model loses when every view is drawn as at one time, in dB."""
    time: float
    """That time, in [0, 1]."""


@dataclass(frozen=True)
class Requirements:
    """What a scene has required of a model; a float is a number of 4 bytes."""

    headline: str
    """The most telling of it in a line."""
    step: int
    num_gaussians: int
    groups: tuple[FloatGroup, ...]
    """All that it takes to draw the model."""
    sh_floats: int
    """Those of spherical harmonics; 0 for colours of another kind."""
    sh_floats_full: int
    """What the same Gaussians would have, each at the highest degree of the settings."""
    rows_by_degree: tuple[int, ...]
    """How many Gaussians have each SH degree, from 0 on; empty without spherical harmonics."""
    training_floats: Mapping[str, int]
    """Kept for training alone: the optimizer's moments, columns that no optimizer moves."""
    views: tuple[str, ...]
    """Names of those that PSNR was measured on."""
    split: str
    """Of these views: "eval" (held out), or "train" where none is held out."""
    protocol: str
    """How all this was measured, in a sentence or two."""
    psnr: float
    """Of the model as it is on these views, in dB."""
    least_useful: tuple[LeastUseful, ...] = ()
    """Growing parts; empty where contributions cannot be measured."""
    motion: Motion | None = None
    """``None`` for what does not change with time."""
    left_out: tuple[str, ...] = ()
    """What the model does not have, as sentences."""
    could_go: tuple[str, ...] = ()
    """What it hardly needs, and which settings leave it out, as sentences."""
    not_measured: tuple[str, ...] = ()
    """What could not be measured here, and why, as sentences."""
    strategy: Mapping[str, Any] = field(default_factory=dict)
    """What the density strategy reports of itself."""
    method: Mapping[str, Any] = field(default_factory=dict)
    """What the method reports of itself."""
    seconds: float = 0.0
    """That measuring took."""

    @property
    def total_floats(self) -> int:
        """All that it takes to draw the model."""
        return sum(group.floats for group in self.groups)

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
