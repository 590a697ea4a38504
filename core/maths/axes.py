"""Axes of a world by name: "z", "-y". Files and scenes say in this way which way is up."""

from __future__ import annotations

import re

import torch
from jaxtyping import Float64
from torch import Tensor

AXIS = re.compile(r"[+-]?[xyz]")
"""Name of an axis, with or without its direction."""
VECTORS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Unit vectors of the axes by name."""
TO_Y = {
    "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-y": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
}
"""Rotation matrices, row by row, that turn an axis to y."""
USUAL_UP = "-y"
"""Up direction of worlds of which nothing is known: in COLMAP's, y leads down."""
AXIS_ERROR = 1e-3
"""Length of the difference below which a direction is an axis, and is called so."""


def stated_axis(stated: object) -> str:
    """The axis that a file states, such as "-y", in lower case; empty for what names no axis.

    Other tools write any text there, or none: the axis is unknown then, and the file is read.
    """
    name = stated.strip().lower() if isinstance(stated, str) else ""
    return name if AXIS.fullmatch(name) else ""


def axis_vector(name: str) -> Float64[Tensor, " 3"]:
    """The unit vector of "x", "+x", "-x" and so on.

    Raises:
        ValueError: it is the name of no axis.
    """
    vector = known_axis(name)
    if vector is None:
        raise ValueError(f"{name!r} is no axis: expected x, y, z, -x, -y or -z")
    return vector


def known_axis(name: str) -> Float64[Tensor, " 3"] | None:
    """The unit vector of an axis; ``None`` for what names none."""
    axis = stated_axis(name)
    if not axis:
        return None
    sign = -1.0 if axis.startswith("-") else 1.0
    return sign * torch.tensor(VECTORS[axis[-1]], dtype=torch.float64)


def known_or_usual_up(name: str) -> Float64[Tensor, " 3"]:
    """The up direction of this name; ``USUAL_UP`` for what names no axis."""
    found = known_axis(name)
    return axis_vector(USUAL_UP) if found is None else found


def turned_to_y(name: str) -> Float64[Tensor, "3 3"]:
    """The rotation matrix, of 0 and 1 and -1, that turns an axis to y; for no axis ``USUAL_UP``."""
    axis = stated_axis(name).removeprefix("+") or USUAL_UP
    return torch.tensor(TO_Y[axis], dtype=torch.float64)


def axis_name(vector: Float64[Tensor, " 3"]) -> str:
    """The name of the axis along a unit vector, such as "-y"; empty if there is none."""
    for axis in VECTORS:
        for name in (axis, f"-{axis}"):
            if float((vector - axis_vector(name).to(vector)).norm()) < AXIS_ERROR:
                return name
    return ""
