"""LearningRate: the learning rate of a parameter as a function of the step."""

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
