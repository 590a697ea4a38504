"""Settings of all methods for moving scenes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from gsfw.core.ranges import number
from gsfw.core.step_settings import steps_field
from gsfw.methods.gaussians3d.config import GaussiansConfig, StaticGaussiansOptim

PAPER_RATES: Mapping[str, float] = {
    "optim.factor": 1.0,
    "optim.cooldown": 0.0,
    "optim.opacities_lr": 5e-2,
}
"""Rates of the methods' papers, for their preset "paper"."""


@dataclass
class MovingOptim(StaticGaussiansOptim):
    """Learning rates of Gaussians that change with time, for runs of any length.

    Measurements are in docs/results/moving-scenes-settings.md#learning-rates.
    """

    factor: float | Literal["auto"] = "auto"
    cooldown: float = number(0.2, at_least=0, at_most=1)
    opacities_lr: float = number(1.5e-2, at_least=0, below=math.inf)
    """Rate of the logits of the opacities. At that of method 3dgs, things that move vanish before
    their motion is learnt."""


@dataclass
class MovingConfig(GaussiansConfig):
    """3D Gaussians, all or some of which change with time."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {"datamanager.moving": True, "strategy.reset_every": 0},
        "paper": PAPER_RATES,
    }
    """default: the built-in scene moves; no opacity resets, which harm motion. paper: the rates of
    Kerbl et al. 2023."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "static_start": "static=auto",
        "static_every": "static=auto",
        "static_tolerance": "static=auto",
        "static_signal": "static=auto",
    }

    static: Literal["none", "auto"] = "none"
    """none: every splat may change with time; auto: only those that need to; the others have no
    temporal parameters and no temporal cost, and can start to move again."""
    static_start: int = steps_field(1000)
    """Steps before any splat becomes static or moving (static=auto)."""
    static_every: int = steps_field(100, at_least=1, floor=50)
    """Steps between rounds in which splats become static, or move again."""
    static_tolerance: float = number(0.1, above=0, below=1)
    """A splat becomes static if, over the sequence, it moves by less than this part of its
    size, and its opacity, shape and colour change by less than this part."""
    static_signal: float = number(1.5, above=1)
    """A static splat moves again above this signal-to-noise ratio of the time dependence of its
    gradients, which is 1 for a splat that needs none; higher: fewer splats move."""
    optim: StaticGaussiansOptim = field(default_factory=MovingOptim)
