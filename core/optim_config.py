"""Settings of the optimizer that every method has."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gsfw.core.learning_rate import Cooldown, LearningRate
from gsfw.core.ranges import number
from gsfw.core.step_settings import steps_field

if TYPE_CHECKING:
    from gsfw.core.loop.optimizer import OptimizerSettings


@dataclass
class OptimConfig:
    """Settings of the optimizer; the learning rates are those of Kerbl et al. 2023."""

    sparse: bool = False
    """Keep rows unchanged that no view of a step has seen (faster; not as in the papers)."""
    batch_scale: float = number(1.0, at_least=1, below=math.inf)
    """Views of a step over those that the rates are made for: rates grow with its root."""
    cooldown: float = number(0.0, at_least=0, at_most=1)
    """Part of the steps, at the end, in which all rates fall linearly to a tenth; 0: none."""
    exposure_lr: float = number(1e-2, at_least=0, below=math.inf)
    """Rate of gains and offsets of the images' colours under exposure=true, of up to 20 images;
    with more of them it falls with the root of their number."""
    exposure_lr_final: float = number(1e-3, at_least=0, below=math.inf)
    """Rate of gains and offsets once it has decayed, log-linearly; of up to 20 images, too."""
    exposure_start: int = steps_field(500)
    """Steps before exposures are learnt, in which splats learn the mean colours."""
    poses_lr: float = number(1e-3, at_least=0, below=math.inf)
    """Rate of camera rotations (radians) and translations (extents) under refine_poses=true."""
    poses_lr_final: float = number(1e-5, at_least=0, below=math.inf)
    """Rate of rotations and translations once it has decayed, log-linearly."""
    poses_start: int = steps_field(500)
    """Steps before cameras move, in which splats learn the rough shape."""
    corrections_lr_steps: int = steps_field(30_000)
    """Steps over which the rates of exposures and poses decay."""

    def settings(self, steps: int) -> OptimizerSettings:
        """Settings for the optimizer of a run of ``steps``."""
        from gsfw.core.loop.optimizer import OptimizerSettings

        cooldown = Cooldown(round(steps * (1 - self.cooldown)), steps)
        return replace(OptimizerSettings.scaled(self.batch_scale, self.sparse), cooldown=cooldown)

    def exposure_rate(self) -> LearningRate:
        """Learning rate of exposures."""
        return self._decaying(self.exposure_lr, self.exposure_lr_final, self.exposure_start)

    def poses_rate(self) -> LearningRate:
        """Learning rate of camera poses."""
        return self._decaying(self.poses_lr, self.poses_lr_final, self.poses_start)

    def _decaying(self, initial: float, final: float, start: int) -> LearningRate:
        return LearningRate(initial, final, self.corrections_lr_steps - start, start)
