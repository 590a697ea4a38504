"""Schedule: the steps after which a run evaluates its model, and writes a checkpoint."""

from __future__ import annotations

from collections.abc import Callable

RECOVERY = 100
"""Steps in which renders recover from an opacity reset. Measured (fox at an eighth of its size,
43 views, reset after step 300): 22.2 dB before, 5.8 at the reset, 21.1 and 24.3 after 50 and 100
steps."""

NEAR_END = 0.1
"""Part of an interval: what falls so shortly before the end is left to the end."""


def checkpoint_due(step: int, steps: int, every: int) -> bool:
    """True if a checkpoint is due after ``step`` steps; one near the end waits for the end.

    Args:
        step: number of finished steps.
        steps: length of the run.
        every: steps between checkpoints; 0 for none before the end.
    """
    if every == 0 or step % every:
        return False
    return step == steps or steps - step > NEAR_END * every


def evaluation_due(step: int, steps: int, every: int, is_reset: Callable[[int], bool]) -> bool:
    """True if an evaluation is due after ``step`` steps, before the end.

    One that would fall shortly after an opacity reset is made before that reset: its figures would
    be those of faint Gaussians, and say nothing of the run.

    Args:
        step: number of finished steps.
        steps: length of the run.
        every: steps between evaluations; 0 for none before the end.
        is_reset: true if the opacities are reset after that many steps.
    """
    is_planned = every > 0 and step % every == 0
    if every == 0 or step == 0 or not (is_planned or is_reset(step + 1)):
        return False
    planned = -(-step // every) * every
    while planned < min(step + RECOVERY, steps):
        if steps - planned > NEAR_END * every and _moved(planned, is_reset) == step:
            return True
        planned += every
    return False


def _moved(planned: int, is_reset: Callable[[int], bool]) -> int:
    """The step of a planned evaluation: its own, or the one before the latest reset."""
    for reset in range(planned, max(planned - RECOVERY, 1), -1):
        if is_reset(reset):
            return reset - 1
    return planned
