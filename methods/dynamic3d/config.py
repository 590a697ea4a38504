"""Settings of method dynamic3dgs; the defaults are those of Luiten et al. 2024, where they fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.core.batch import SEGMENTATION
from gsfw.core.capabilities import Needs
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number
from gsfw.core.step_settings import Rescaled, steps_field
from gsfw.methods.gaussians3d.config import GaussiansConfig, StaticGaussiansOptim

if TYPE_CHECKING:
    from gsfw.core.method import Method

TRACKING_COST = 2.5
"""Time of a step of tracking over one of the first time, as a median of 57 recorded runs."""


@dataclass
class TrackedGaussiansOptim(StaticGaussiansOptim):
    """Learning rates: those of method 3dgs for the first time, and those of tracking.

    The paper tracks with a constant 1.6e-4 for positions and 1e-3 for quaternions, for 2000 steps
    at each time. Higher initial rates with a decay within each time need a tenth of the steps.
    """

    factor: float | Literal["auto"] = "auto"
    means_lr_steps: int = steps_field(10_000)
    """Steps over which the rate of positions decays at the first time."""
    segmentation_lr: float = number(5e-2, at_least=0, below=math.inf)
    """Rate of the logits of the segmentation, at the first time; they are fixed afterwards."""
    tracked_means_lr: float = number(6e-3, at_least=0, below=math.inf)
    """Rate of positions at the first step of every later time, times the scene's extent."""
    tracked_quats_lr: float = number(1e-2, at_least=0, below=math.inf)
    """Rate of the quaternions at the first step of every later time."""
    tracked_decay: float = number(0.03, above=0, at_most=1)
    """Final rates of both at the last step of a time, relative to its first."""


@dataclass
class TrackedGaussiansConfig(GaussiansConfig):
    """Persistent Gaussians, tracked through time (Luiten et al. 2024)."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {
            "datamanager.moving": True,
            "sampler": "sequential",
            "sampler.views_per_step": 2,
            "strategy.reset_every": 0,
            "strategy.refine_stop": Rescaled(5_000),
        },
        "paper": {"optim.factor": 1.0, "optim.cooldown": 0.0},
    }
    """Times in order, two views in a step, Gaussians added and removed at the first time only, and
    no opacity resets.

    Measured on the built-in moving scene (480 x 360, 3000 steps, seed 42; median error of moving
    points in scene units / PSNR / PSNR where things move): 0.0089 / 28.81 / 24.37 dB with one view,
    rotation=4, isometry=2, tracked_means_lr=3e-3, tracked_decay=0.1 and straight extrapolation;
    0.0074 / 28.96 / 24.30 dB as here. Not chosen, at 160 x 120: rigid=16 rotation=16 isometry=8
    with the former rates (1500 steps), 0.0121 after 0.0094 and 25.45 after 27.32 dB; three views,
    rigid=6, isometry=6 and tracked_decay=0.01 (3000 steps), 0.0067 after 0.0085 and 29.46 after
    29.83 dB."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "color_change": "colors=soft",
    }

    colors: Literal["soft", "fixed"] = "soft"
    """Change constant colours with time, at a cost (color_change)."""
    rigid: float = number(4.0, at_least=0, below=math.inf)
    """Weight of the distance of neighbours from their positions under a row's own motion, in
    extents."""
    rotation: float = number(16.0, at_least=0, below=math.inf)
    """Weight of the difference of neighbours' rotations, as a difference of quaternions."""
    isometry: float = number(4.0, at_least=0, below=math.inf)
    """Weight of the change of distances to neighbours since the first time, in extents."""
    color_change: float = number(0.01, at_least=0, below=math.inf)
    """Weight of the change of colours since the previous time (colors=soft)."""
    segmentation_weight: float = number(3.0, at_least=0, below=math.inf)
    """Weight of the loss of the rendered segmentation, if views have a map "segmentation" (1 where
    the foreground is, else 0); 0: masks are not used."""
    background_weight: float = number(20.0, at_least=0, below=math.inf)
    """Weight of the change of background rows since the first time, in extents and quaternions; no
    effect without a map "segmentation"."""
    neighbors: int = number(20, at_least=1)
    """Neighbours of each row, found once, when the first time is finished."""
    neighbors_per_step: int = number(5, at_least=1)
    """Number of neighbours in the loss of a step, in turn; the time is in proportion."""
    optim: TrackedGaussiansOptim = field(default_factory=TrackedGaussiansOptim)

    def step_costs(self) -> tuple[tuple[int, float], ...]:
        """Steps of the first time, and of the tracking of the others."""
        first = getattr(self.sampler, "first_steps", 0)
        return ((0, 1.0), (first, TRACKING_COST)) if first else ((0, 1.0),)

    def build(self) -> Method:
        """Build the method."""
        from gsfw.methods.dynamic3d.method import TrackedGaussiansMethod

        return TrackedGaussiansMethod(self)

    def check(self) -> None:
        """Check the values of every run, and this method's own.

        Raises:
            ConfigError: a value is wrong; names the key, the expected and the given value.
        """
        super().check()
        if self.sh == "adaptive":
            raise ConfigError(
                "sh=adaptive: tracked Gaussians keep the bands that they have at the first time.",
                "Give all of them the same with sh=0 to sh=4.",
            )
        if self.neighbors_per_step > self.neighbors:
            raise ConfigError(
                f"neighbors_per_step={self.neighbors_per_step}: expected at most "
                f"neighbors={self.neighbors}.",
                f"Give neighbors_per_step={self.neighbors} or less, or more neighbors.",
            )
        if self.sampler is not None and not self.sampler.in_time_order:
            raise ConfigError(
                f"method 'dynamic3dgs' follows a scene from each time to the next, and its sampler "
                f"({type(self.sampler).__name__}) may go back in time.",
                "Leave out sampler=, or give sampler=sequential, which is this method's own. A "
                "sampler that never goes back declares in_time_order = True.",
            )
        self._check_refinement()

    def needs(self) -> Needs:
        """An extra channel if the data may have masks of the foreground."""
        named = {str(text).partition(":")[0] for text in getattr(self.datamanager, "maps", ())}
        named |= getattr(self.datamanager, "own_maps", frozenset())
        masked = self.segmentation_weight > 0 and SEGMENTATION in named
        return super().needs() | Needs(extra_channels=int(masked))

    def _check_refinement(self) -> None:
        """Refuse changes of rows during tracking: new rows would have no past.

        A sampler without a length of the first time is not this method's own; a strategy without a
        last step does not refine.
        """
        first = getattr(self.sampler, "first_steps", None)
        stop = getattr(self.strategy, "refine_stop", None)
        if first is not None and stop is not None and stop > first:
            raise ConfigError(
                f"strategy.refine_stop={stop}: method 'dynamic3dgs' adds and removes Gaussians "
                f"at the first time only, which ends after sampler.first_steps={first} steps.",
                f"Give strategy.refine_stop={first // 2} or so.",
            )
