"""ViewLosses: the decrease of the loss of each view since its last render."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.maths.ssim import masked_mean
from gsfw.core.render_output import RenderStatistics


@dataclass(frozen=True)
class _Visit:
    """The last render of a view."""

    step: int
    width: int
    """Width in pixels: smaller images have less detail, and smaller losses."""
    loss: Tensor
    counts: Tensor | bool = True
    """False where no step that counts has rendered the view so far."""


class ViewLosses:
    """Compares every view with itself, so that the difficulty of views cancels.

    The loss is the mean absolute difference of valid pixels. Only ``mean_loss`` and
    ``gain_per_step`` wait for a GPU.
    """

    def __init__(self) -> None:
        self._last: dict[int, _Visit] = {}
        self._loss: Tensor | float = 0.0
        self._gain: Tensor | float = 0.0
        self._visits: Tensor | int = 0
        self._compared = 0

    @torch.no_grad()
    def add(self, context: StepContext, statistics: RenderStatistics) -> None:
        """Add a batch; a loss that is not finite, or of a step that is none, is no change.

        Args:
            context: the batch.
            statistics: of it; zeros where the step has changed nothing.
        """
        counted = statistics.visible.any(1)
        width = context.batch.cameras.width
        errors = (context.rendered.color - context.target).abs()
        valid = context.batch.valid
        for place, view in enumerate(context.batch.views):
            here = slice(place, place + 1)
            found = masked_mean(errors[here], None if valid is None else valid[here])
            last = self._last.get(view)
            before = found.new_zeros(()) if last is None else last.loss
            known = False if last is None else last.counts
            is_new = found.isfinite() & counted[place]
            loss, counts = torch.where(is_new, found, before), is_new | known
            if last is not None and last.width == width and last.step < context.step:
                gain = (before - loss) * known
                self._gain = self._gain + gain / (context.step - last.step)
                self._compared += 1
            self._loss = self._loss + loss
            self._visits = self._visits + counts
            self._last[view] = _Visit(context.step, width, loss, counts)

    @property
    def num_compared(self) -> int:
        """Number of visits since the last ``clear`` with an earlier visit of the same view."""
        return self._compared

    @property
    def mean_loss(self) -> float:
        """Mean over all visits since the last ``clear``."""
        return float(self._loss) / max(float(self._visits), 1.0)

    @property
    def gain_per_step(self) -> float:
        """Mean decrease of the loss of a view per step, over the compared visits."""
        return float(self._gain) / max(self._compared, 1)

    def clear(self) -> None:
        """Restart the means; later visits are still compared with earlier ones."""
        self._loss = self._gain = 0.0
        self._visits = self._compared = 0

    def forget(self) -> None:
        """Forget all visits: the model was changed, and has to recover."""
        self._last = {}

    def state_dict(self) -> dict[str, Any]:
        """The last visits, and the sums."""
        last = {
            view: (visit.step, visit.width, visit.loss, visit.counts)
            for view, visit in self._last.items()
        }
        sums = {"loss": self._loss, "gain": self._gain}
        return {"last": last, **sums, "visits": self._visits, "compared": self._compared}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        self._last = {view: _Visit(*visit) for view, visit in state["last"].items()}
        self._loss, self._gain = state["loss"], state["gain"]
        self._visits, self._compared = state["visits"], state["compared"]
