"""Splats and cameras in other frames, and splats by their principal axes."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.rotations import multiply_quaternions, quaternions_of
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import degree_of, rotate_sh
from gsfw.core.maths.symmetric import principal_axes
from gsfw.core.splats import Sh, Splats

CHUNK = 1 << 14
"""Rows whose colours are rotated at once: that takes ten times their memory."""


def transform_splats(splats: Splats, similarity: Similarity) -> Splats:
    """Transform splats to the frame that ``similarity`` leads to; the result is float64.

    View-dependent colours rotate with the frame, and keep their type: they are most of the memory.
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
        turn = quaternions_of(rotation).expand_as(splats.quats)
        moved = replace(moved, quats=multiply_quaternions(turn, splats.quats.double()))
    if isinstance(splats.colors, Sh):
        stored = replace(splats.colors, degree=degree_of(splats.colors.width))
        coefficients = _rotated(stored, rotation)
        moved = replace(moved, colors=Sh(coefficients, splats.colors.degree))
    return moved


def in_frame(cameras: Cameras, frame: Similarity) -> Cameras:
    """The cameras in the frame that a similarity leads to, float64, on the CPU."""
    cameras = cameras.to("cpu", torch.float64)
    intrinsics = cameras.intrinsics.clone()
    if cameras.model is CameraModel.ORTHOGRAPHIC:  # In pixels per unit of length.
        intrinsics[:, [0, 1], [0, 1]] /= frame.scale
    poses = frame.camera(cameras.world_to_camera)
    return replace(cameras, world_to_camera=poses, intrinsics=intrinsics)


def _rotated(colors: Sh, rotation: Float[Tensor, "3 3"]) -> Float[Tensor, "n k 3"]:
    """Rotated SH colours as dense coefficients, computed in float64 by parts."""
    given = colors.coefficients
    rows = torch.arange(len(given), device=given.device)
    if torch.equal(rotation, torch.eye(3).to(rotation)) or not len(rows):
        return colors.dense()
    width = colors.take(rows[:1]).dense().shape[1]
    rotated = given.new_empty(len(given), width, 3)
    for start in range(0, len(given), CHUNK):
        part = colors.take(rows[start : start + CHUNK]).dense()
        rotated[start : start + CHUNK] = rotate_sh(part.double(), rotation).to(part)
    return rotated


@torch.no_grad()
def with_axes(splats: Splats) -> Splats:
    """Convert splats to quaternions and scales, largest last; unchanged if they have them.

    Eigenvalues are computed in float64, by the host; negative ones (by rounding) become zero.
    """
    if splats.covariances is None:
        return splats
    variances, axes = principal_axes(splats.covariances)
    return replace(
        splats,
        quats=quaternions_of(axes).to(splats.means),
        scales=variances.clamp_min(0.0).sqrt().to(splats.means),
        covariances=None,
    )
