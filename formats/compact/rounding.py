"""Rounding: the values that a compressed file makes of a model, while the model is trained on.

The steps are those of the model at the start. A file that is written of what training has made of
it, ``with_steps``, holds exactly the values that the training has seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.exchange import ExportSource, StoredModel
from gsfw.formats.compact.column_code import fits
from gsfw.formats.compact.position_code import Lattice
from gsfw.formats.compact.row_order import MEANS, RowOrder
from gsfw.formats.compact.steps import Form, rule_of, weights_of
from gsfw.formats.compact.value_forms import quantised, restored


@dataclass(frozen=True)
class ColumnSteps:
    """The rounding of one column."""

    steps: Float64[np.ndarray, " m"]
    """Step of each value row in the order of the model; of positions, the pitch."""
    form: Form | None
    """``None`` for positions."""

    def rounded(self, values: Float64[np.ndarray, "m d"]) -> Float64[np.ndarray, "m d"]:
        """The values that a file gives back; quaternions keep their lengths and signs."""
        if self.form is None:
            return Lattice.of(values, self.steps).centers()
        with np.errstate(over="ignore"):
            if not fits(values, self.steps):
                return values
        found = restored(quantised(values, self.steps, self.form), self.steps, self.form)
        if self.form is Form.UNIT_QUATS:
            # The same rotation, near to the values: training goes on from these.
            signs = np.where((found * values).sum(axis=1, keepdims=True) < 0, -1, 1)
            found *= signs * np.linalg.norm(values, axis=1, keepdims=True)
        return found


@dataclass(frozen=True)
class Rounding:
    """The rounding of a model's columns in a compressed file."""

    contributions: Float[Tensor, " n"] | None
    """Contributions of the rows at the start, or the estimate that takes their place."""
    pitches: Float[Tensor, " n"]
    """Pitch of the position of each row at the start."""
    columns: dict[str, ColumnSteps]
    """By name; the other columns are not rounded visibly."""

    @staticmethod
    def of(
        model: StoredModel, step: float, contributions: Float[Tensor, " n"] | None
    ) -> Rounding | None:
        """The rounding of a model at its present state; ``None`` if its rows have no steps.

        Args:
            model: the model.
            step: factor of all steps.
            contributions: of its rows to the training views; ``None`` for an estimate.
        """
        if not RowOrder.fits(model):
            return None
        order = RowOrder.of(model, step, contributions)
        place = np.argsort(order.rows)
        pitches = order.lattice.pitches()[place]
        weights = weights_of(model, contributions)
        columns = {MEANS: ColumnSteps(pitches, None)}
        for name, column in model.columns.items():
            rule = rule_of(name, model)
            if rule is None or column.layout is Layout.STACKED:  # Times that are over.
                continue
            steps = order.steps(rule.step * step, rule.unit)[place]
            if column.offsets is not None:
                steps = np.repeat(steps, model.state[column.offsets].diff().cpu().numpy())
            columns[name] = ColumnSteps(steps, rule.form)
        weighed = None if weights is None else torch.from_numpy(weights)
        return Rounding(weighed, torch.from_numpy(pitches), columns)

    def __call__(self, name: str, values: Tensor) -> Tensor:
        """The values of a column as a file gives them back, on the same device."""
        column = self.columns.get(name)
        if column is None or not len(values):
            return values.detach()
        flat = values.detach().cpu().double().reshape(len(values), -1).numpy()
        found = torch.from_numpy(column.rounded(flat))
        return found.reshape(values.shape).to(values)

    def with_steps(self, trained: StoredModel) -> RoundedModelSource:
        """The trained model, to be written with the steps of the start."""
        return RoundedModelSource(replace(trained, pitches=self.pitches), self.contributions)


@dataclass(frozen=True)
class RoundedModelSource(ExportSource):
    """A model for a file whose steps are given."""

    model: StoredModel
    """The model with its pitches."""
    weights: Float[Tensor, " n"] | None

    def stored_model(self) -> StoredModel:
        """The model."""
        return self.model

    def contributions(self) -> Float[Tensor, " n"] | None:
        """The contributions that its steps were made of."""
        return self.weights
