"""Moving splats between frames."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import degree_of, rotate_sh
from gsfw.core.splats import Sh, Splats


def quaternion_of(rotation: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 4"]:
    """The unit quaternions (wxyz, w >= 0) of rotation matrices, by their largest components."""
    m = rotation.movedim((-2, -1), (0, 1))
    squares = torch.stack(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    products = torch.stack(
        [
            torch.stack([squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]),
            torch.stack([m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]]),
            torch.stack([m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]]),
            torch.stack([m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]]),
        ]
    )
    largest = squares.argmax(dim=0, keepdim=True)[:, None]
    quat = products.take_along_dim(largest, dim=0)[0].movedim(0, -1)
    quat = quat / quat.norm(dim=-1, keepdim=True)
    return torch.where(quat[..., :1] >= 0, quat, -quat)


def multiply_quaternions(
    first: Float[Tensor, "*b 4"], second: Float[Tensor, "*b 4"]
) -> Float[Tensor, "*b 4"]:
    """Hamilton product, wxyz: rotate by ``second``, then by ``first``."""
    a, b, c, d = first.unbind(-1)
    p, q, r, s = second.unbind(-1)
    return torch.stack(
        [
            a * p - b * q - c * r - d * s,
            a * q + b * p + c * s - d * r,
            a * r - b * s + c * p + d * q,
            a * s + b * r - c * q + d * p,
        ],
        dim=-1,
    )


def transform_splats(splats: Splats, similarity: Similarity) -> Splats:
    """The same splats in the frame that ``similarity`` leads to; the result is float64.

    View-dependent colours turn with the frame.
    """
    rotation, scale = similarity.rotation, similarity.scale
    moved = Splats(
        means=similarity.apply(splats.means),
        opacities=splats.opacities.double(),
        colors=splats.colors if isinstance(splats.colors, Sh) else splats.colors.double(),
        extra=None if splats.extra is None else splats.extra.double(),
        rows=splats.rows,
        covariances=(
            None
            if splats.covariances is None
            else scale**2 * rotation @ splats.covariances.double() @ rotation.T
        ),
        scales=None if splats.scales is None else splats.scales.double() * scale,
    )
    if splats.quats is not None:
        turn = quaternion_of(rotation).expand_as(splats.quats)
        moved = replace(moved, quats=multiply_quaternions(turn, splats.quats.double()))
    if isinstance(splats.colors, Sh):
        stored = replace(splats.colors, degree=degree_of(splats.colors.width))
        coefficients = rotate_sh(stored.dense().double(), rotation)
        moved = replace(moved, colors=Sh(coefficients, splats.colors.degree))
    return moved
