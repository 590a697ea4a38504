"""Settings that all methods for scenes that move share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gsfw.core.config import steps_field
from gsfw.core.ranges import number
from gsfw.methods.gaussians3d.config import GaussiansConfig


@dataclass
class MovingConfig(GaussiansConfig):
    """3D Gaussians, all or some of which change with time."""

    static: Literal["none", "auto"] = "none"
    """none: every splat may change with time; auto: only those that need to, the others have no
    parameters of time, cost nothing of it, and can come back."""
    static_start: int = steps_field(1000)
    """Steps before any splat changes whether it stands still (static=auto)."""
    static_every: int = steps_field(100, at_least=1, floor=50)
    """Steps between looks at which splats are to stand still, and which are to move again."""
    static_tolerance: float = number(0.1, above=0, below=1)
    """A splat is to stand still if, over the sequence, it moves by less than this part of its
    size, and its opacity, shape and colour change by less than this part."""
    static_signal: float = number(1.5, above=1)
    """A splat is to move again above this signal-to-noise ratio of what its gradients have to do
    with time, which is 1 for one that needs none; higher: fewer splats move."""
