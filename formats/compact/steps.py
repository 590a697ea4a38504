"""Steps: how far apart the stored values of each column lie, and why.

The steps share the error evenly: one step of each column, alone, costs the images of trained models
the same error for each stored value, which is the optimum of rate and distortion where steps are
small (a bit of any value then saves the same error). They were measured on the built-in scene and
on fox (docs/results/compression.md); one factor scales them all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.exchange import StoredModel


class Form(Enum):
    """The part of a value that is stored in steps."""

    PLAIN = "plain"
    COLORS = "colors"
    """Luminance and two chrominances in place of red, green and blue, by a rotation."""
    UNIT_QUATS = "unit quats"
    """The three smaller components of the unit quaternion, and the index of the largest."""
    OPACITIES = "opacities"
    """The angle whose squared sine is the opacity: fine where it is near 0 or 1."""


class Unit(Enum):
    """Unit of a step."""

    ONE = "one"
    ROW = "row"
    """Finer for rows that contribute more."""
    PITCH = "pitch"
    """The pitch of the row's position."""


@dataclass(frozen=True)
class Rule:
    """Step of a column."""

    step: float
    unit: Unit = Unit.ROW
    form: Form = Form.PLAIN


PITCH = 0.1
"""Pitch of a position relative to the shortest axis of its splat."""
RULES: Mapping[str, Rule] = {
    "log_scales": Rule(0.09),
    "opacity_logits": Rule(0.07, Unit.ONE, Form.OPACITIES),
    "quats": Rule(0.016),
    "sh_dc": Rule(0.05, form=Form.COLORS),
    "sh_rest": Rule(0.045, form=Form.COLORS),
    "time_centers": Rule(0.004),
    "log_durations": Rule(0.06),
    "motion": Rule(1.0, Unit.PITCH),
    "spins": Rule(0.016),
    "features": Rule(0.02),
    "feature_rates": Rule(0.02),
    "time_quats": Rule(0.002),
    "past_means": Rule(1.0, Unit.PITCH),
    "past_quats": Rule(0.016 * 32767),
    "past_colors": Rule(0.05, form=Form.COLORS),
}
"""Rules of the columns that docs/guides/model-file.md describes, by name."""
STATIC = frozenset({"means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest"})
EVIDENCE = frozenset({"stillness", "terms", "band_evidence", "band_weights"})
"""Columns of which nothing is rendered: evidence of training, which is left out (read as 0)."""
FOURTH_AXIS = "time_quats"
"""A column of models whose paths follow from both quaternions, which have the same step."""


def rule_of(name: str, model: StoredModel) -> Rule | None:
    """The rule of a column; ``None`` for those that are stored in half precision."""
    if name == "quats" and not _moves(model):
        return Rule(RULES[name].step, form=Form.UNIT_QUATS)
    if name == "quats" and FOURTH_AXIS in model.columns:
        return RULES[FOURTH_AXIS]
    return RULES.get(name)


def _moves(model: StoredModel) -> bool:
    """True if there is more than static Gaussians; the norm of a quaternion may have a meaning."""
    held = {part for column in model.columns.values() for part in (column.values, column.offsets)}
    return bool(model.columns.keys() - STATIC - EVIDENCE) or bool(model.state.keys() - held)


CONTRIBUTION_POWER = 0.4
"""Steps fall with this power of a row's contribution. For errors that the contribution multiplies
the optimum of small steps is 0.5; many steps are coarse, where measurement says 0.35 to 0.45."""
MOST = 8
"""Largest magnitude of a fineness: steps between 1/16 and 16 of the mean."""


def fineness(
    model: StoredModel, contributions: Float[Tensor, " n"] | None
) -> Int64[np.ndarray, " n"]:
    """Exponent of each row's steps, in units of the square root of 2.

    Args:
        model: the model.
        contributions: of its rows to the training views; ``None`` for an estimate.
    """
    weights = weights_of(model, contributions)
    if weights is None:
        return np.zeros(model.rows, dtype=np.int64)
    floor = max(float(np.quantile(weights, 0.05)), np.finfo(np.float32).tiny)
    logs = np.log2(weights + floor)
    return (
        np.rint(-2 * CONTRIBUTION_POWER * (logs - logs.mean())).clip(-MOST, MOST).astype(np.int64)
    )


def weights_of(
    model: StoredModel, contributions: Float[Tensor, " n"] | None
) -> Float64[np.ndarray, " n"] | None:
    """Contributions of the rows, or an estimate; ``None`` where there is no ground for one."""
    if not model.rows:
        return None
    if contributions is not None:
        return contributions.double().cpu().numpy()
    logits, log_scales = (dense_column(model, name) for name in ("opacity_logits", "log_scales"))
    if logits is None or log_scales is None:
        return None
    # What a splat adds to an image grows with its opacity and its area, and more opaque ones
    # hide others.
    longest = log_scales.double().sort(dim=1).values[:, 1:].sum(dim=1)
    return (logits.double().sigmoid().square() * longest.exp()).numpy()


def dense_column(model: StoredModel, name: str) -> Tensor | None:
    """Values of a dense column in float32; ``None`` if there is none of this name."""
    column = model.columns.get(name)
    if column is None or column.layout is not Layout.DENSE:
        return None
    values = model.state[column.values]
    return values if values.dtype == torch.float32 else None
