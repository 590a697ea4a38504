"""Fine-tuning: trains a run on after its end, for the rounding that a file will bring.

The rows stay. Rates are those of the end of the schedule, and cool down over the steps of the
fine-tuning: fox has 30.68 dB, 30.38 at constant rates, and 29.93 at those of the end of a cooldown
(300 steps after 300, format.precision=compressed format.step=3). The run's folder is not changed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gsfw.core.callback import Callback, Control
from gsfw.core.column import Layout
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import Cooldown
from gsfw.core.loop.checkpoint_file import fitting_state
from gsfw.core.loop.evaluation import evaluate
from gsfw.core.loop.rounded_model import Rounded, RoundedModel
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.model import PrimitiveModel
from gsfw.core.progress import stage
from gsfw.core.refinement.refiners import Refiners
from gsfw.plugins.restore import Restored


@dataclass(frozen=True)
class Effect:
    """Mean PSNR of the held-out views in dB; ``None`` where none are held out."""

    usual: float | None
    """The model as it was trained."""
    rounded: float | None
    """The same, rounded."""
    fine_tuned: float | None
    """The fine-tuned model, rounded."""


def fine_tune(restored: Restored, steps: int, rounded: Rounded) -> Effect:
    """Train the model of a run, in place, such that it is good when rounded.

    Args:
        restored: a run, with its optimizer; its model changes.
        steps: number of updates.
        rounded: rounds the values of a column.

    Raises:
        ConfigError: the method trains one time after another.
        TrainingError: too many steps were not finite.
    """
    composition = restored.composition
    parts, plan = composition.parts, composition.plan
    if any(column.layout is Layout.STACKED for column in parts.model.columns().values()):
        raise ConfigError(
            f"finetune={steps}: method {composition.settings.method.name} trains one time after "
            "another, and those that are over cannot be trained on.",
            "Leave finetune out.",
        )
    shown = RoundedModel(parts.model, rounded)
    usual, before = (_psnr(restored, model) for model in (parts.model, shown))
    parts = replace(
        parts, rendered=shown, refiners=Refiners(), metrics={"psnr": parts.metrics["psnr"]}
    )
    first = max(plan.steps, restored.step)
    cooldown = Cooldown(first, first + steps)
    parts.optimizer.settings = replace(parts.optimizer.settings, cooldown=cooldown)
    plan = replace(plan, steps=first + steps, eval_every=0, checkpoint_every=0, held_back=0)
    with stage("fine-tuning", steps) as advance:
        folder, progress = _NoFolder(Path(os.devnull)), _Progress(first, advance)
        trainer = replace(composition, parts=parts, plan=plan).trainer(folder, [progress], first)
        with fitting_state(str(restored.folder.path)):
            trainer.load_state_dict({**restored.state, "step": first})
        trainer.walk.unhurried()
        summary = trainer.fit()
    return Effect(usual, before, summary.get("psnr"))


def _psnr(restored: Restored, model: PrimitiveModel) -> float | None:
    parts, settings = restored.composition.parts, restored.composition.plan.settings
    metrics = {"psnr": parts.metrics["psnr"]}
    found = evaluate(replace(parts, rendered=model, metrics=metrics), settings)
    return found.means.get("psnr")


class _Progress(Callback):
    """Shows the steps."""

    def __init__(self, first: int, advance: Callable[[int], None]) -> None:
        self._first, self._advance = first, advance

    def on_tick(self, step: int, control: Control) -> None:
        """Show a step."""
        self._advance(step - self._first)


class _NoFolder(RunFolder):
    """Writes no checkpoints."""

    def write_checkpoint(self, step: int, state: Mapping[str, Any], keep: int = 2) -> Path:
        """Write nothing."""
        return self.path
