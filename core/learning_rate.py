"""Learning rates as functions of the step: of one parameter, and the cooldown of all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class LearningRate:
    """Log-linear from ``initial`` to ``final`` over ``steps``, constant after that.

    Kerbl et al. 2023 decay positions so; the form is that of Plenoxels' and JAXNeRF's schedules.
    """

    initial: float
    """Learning rate at ``start``."""
    final: float | None = None
    """Learning rate at the end of the decay; ``None``: constant."""
    steps: int = 1
    """Steps from ``start`` to ``final``."""
    start: int = 0
    """The rate is zero before this step (a later phase); the decay starts here."""

    def at(self, step: int) -> float:
        """The rate at ``step``, counted from 0."""
        if step < self.start:
            return 0.0
        if self.final is None:
            return self.initial
        if self.initial <= 0 or self.final <= 0:
            return self.initial
        fraction = min((step - self.start) / max(self.steps, 1), 1.0)
        return float(self.initial * (self.final / self.initial) ** fraction)

    def times(self, factor: float) -> LearningRate:
        """The same course at ``factor`` times the rate."""
        final = None if self.final is None else self.final * factor
        return replace(self, initial=self.initial * factor, final=final)


COOLED = 0.1
"""Factor of all rates at the end of a cooldown. 0.01 is worse by 0.05 dB (fox, 600 steps)."""


@dataclass(frozen=True)
class Cooldown:
    """Factor of all learning rates, which falls linearly from 1 to ``COOLED`` at the end of a run.

    At a constant rate, parameters keep following the views of the latest steps; at lower rates they
    settle between all views. The form is that of Hägele et al. 2024 (arXiv:2405.18392, section 3).
    """

    start: int = 0
    """Step from which the factor falls."""
    end: int = 0
    """Step at which it is ``COOLED``, and stays so; no later than ``start``: no cooldown."""

    def factor(self, step: int) -> float:
        """The factor at ``step``, counted from 0."""
        if self.end <= self.start:
            return 1.0
        fraction = min(max((step - self.start) / (self.end - self.start), 0.0), 1.0)
        return 1.0 - (1.0 - COOLED) * fraction
