"""Value forms: the numbers of a column before and after their division into steps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from gsfw.formats.compact.steps import Form
from gsfw.formats.smallest_three import from_smallest_three, smallest_three

COLORS = np.array(
    [
        [1 / np.sqrt(3), 1 / np.sqrt(3), 1 / np.sqrt(3)],
        [1 / np.sqrt(2), 0, -1 / np.sqrt(2)],
        [1 / np.sqrt(6), -2 / np.sqrt(6), 1 / np.sqrt(6)],
    ]
)
"""A rotation; within a few degrees of the principal axes of trained coefficients."""
FAINTEST, DENSEST = 1e-4, 1 - 1e-5
"""Opacities that 0 and 1 are read as; logits are finite."""


def quantised(
    values: Float64[np.ndarray, "m d"], steps: Float64[np.ndarray, " m"], form: Form
) -> Int64[np.ndarray, "m e"]:
    """The numbers of steps that come nearest to values of ``form``."""
    if form is Form.COLORS:
        triples = values.reshape(len(values), -1, 3) @ COLORS.T
        return _rounded(triples.reshape(len(values), -1), steps)
    if form is Form.OPACITIES:
        opacities = 1 / (1 + np.exp(-values.clip(-700, 700)))
        return _rounded(np.arcsin(np.sqrt(opacities)), steps)
    if form is Form.UNIT_QUATS:
        lengths = np.linalg.norm(values, axis=1, keepdims=True)
        units = np.where(lengths > 0, values / np.maximum(lengths, 1e-300), [1.0, 0, 0, 0])
        largest, three = smallest_three(units)
        return np.concatenate([largest[:, None], _rounded(three, steps)], axis=1)
    return _rounded(values, steps)


def restored(
    counts: Int64[np.ndarray, "m e"], steps: Float64[np.ndarray, " m"], form: Form
) -> Float64[np.ndarray, "m d"]:
    """The values of numbers of steps.

    Raises:
        ValueError: a quaternion has no such component.
    """
    if form is Form.UNIT_QUATS:
        largest = counts[:, 0]
        if ((largest < 0) | (largest > 3)).any():
            raise ValueError("a quaternion has more than four components")
        return from_smallest_three(largest, counts[:, 1:] * steps[:, None])
    values = counts * steps[:, None]
    if form is Form.COLORS:
        return (values.reshape(len(values), -1, 3) @ COLORS).reshape(len(values), -1)
    if form is Form.OPACITIES:
        opacities = np.sin(values.clip(0, np.pi / 2)) ** 2
        opacities = opacities.clip(FAINTEST, DENSEST)
        return np.log(opacities) - np.log1p(-opacities)
    return values


def channels(width: int, form: Form) -> int:
    """Numbers that are stored for each value row of ``width`` numbers."""
    return 4 if form is Form.UNIT_QUATS else width


def _rounded(
    values: Float64[np.ndarray, "m d"], steps: Float64[np.ndarray, " m"]
) -> Int64[np.ndarray, "m d"]:
    return np.rint(values / steps[:, None]).astype(np.int64)
