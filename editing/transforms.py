"""Transforms: similarities that move, rotate and scale a world, and their composition."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.maths.axes import axis_name, known_axis
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.core.maths.similarity import Similarity


def composed(second: Similarity, first: Similarity) -> Similarity:
    """The similarity that applies ``first``, then ``second``."""
    return Similarity(
        second.scale * first.scale,
        second.rotation @ first.rotation,
        second.apply(first.translation),
    )


def move(by: Float64[Tensor, " 3"]) -> Similarity:
    """A translation, in the units of the world."""
    return Similarity(translation=by)


def rotate(axis: Float64[Tensor, " 3"], degrees: float) -> Similarity:
    """A rotation about an axis through the origin, by the right-hand rule.

    Raises:
        ValueError: the axis has no length.
    """
    length = float(axis.norm())
    if not length > 0:
        raise ValueError("the axis of a rotation has no length")
    vector = axis / length * math.radians(degrees)
    return Similarity(rotation=rotation_vector_matrices(vector[None])[0])


def scale(factor: float) -> Similarity:
    """A scaling about the origin.

    Raises:
        ValueError: the factor is not positive and finite.
    """
    if not (factor > 0 and math.isfinite(factor)):
        raise ValueError(f"a scale of {factor:g}: expected a positive number")
    return Similarity(scale=factor)


def rotation_between(
    start: Float64[Tensor, " 3"], end: Float64[Tensor, " 3"]
) -> Float64[Tensor, "3 3"]:
    """The rotation matrix by the smallest angle that turns one unit vector into another."""
    across = torch.linalg.cross(start, end)
    sine, cosine = float(across.norm()), float(start @ end)
    if sine < 1e-12:
        if cosine > 0:
            return torch.eye(3, dtype=torch.float64)
        # Half a turn, about any axis at a right angle.
        other = torch.eye(3, dtype=torch.float64)[int(start.abs().argmin())]
        across, sine = torch.linalg.cross(start, other), 0.0
    axis = across / across.norm()
    return rotate(axis, math.degrees(math.atan2(sine, cosine))).rotation


def up_after(up: str, similarity: Similarity) -> str:
    """The up direction of a file after a transform; empty if it is along no axis (any more)."""
    before = known_axis(up)
    return "" if before is None else axis_name(similarity.rotation @ before)
