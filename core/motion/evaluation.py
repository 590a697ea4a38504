"""Evaluation of motion in closed form: the splats at a time, and the motion in another frame.

The reference for players of exported files.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.exchange import Motion, MotionFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import multiply_quaternions, quaternions_of, unit_quaternions
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Splats


def splats_at(file: MotionFile, time: float) -> Splats:
    """The splats that are present at a time, with their ``rows`` in the file.

    Args:
        file: splats with motion.
        time: in [0, 1].

    A rotation whose quaternion passes through 0 is the identity there.
    """
    rows = ((file.motion.begin <= time) & (time < file.motion.end)).nonzero()[:, 0]
    splats, motion = file.content.splats.take(rows), file.motion.take(rows)
    elapsed = time - motion.center
    return replace(_after(elapsed, splats, motion), rows=rows)


def all_splats_at(file: MotionFile, time: float) -> Splats:
    """Every splat of the file at a time, for files of the same rows at each time.

    One that is absent has an opacity of 0, and is where it was or will be present.
    """
    motion = file.motion
    clamped = torch.full_like(motion.center, time).clamp(motion.begin, motion.end)
    splats = _after(clamped - motion.center, file.content.splats, motion)
    is_present = (motion.begin <= time) & (time < motion.end)
    return replace(splats, opacities=torch.where(is_present, splats.opacities, 0.0))


def _after(elapsed: Float[Tensor, " n"], still: Splats, motion: Motion) -> Splats:
    """Splats some time after the centre of each one."""
    assert still.quats is not None
    assert still.scales is not None
    powers = torch.stack([elapsed, elapsed**2, elapsed**3], dim=1)
    quats = still.quats + motion.spin * elapsed[:, None]
    return replace(
        still,
        means=still.means + (motion.path * powers[:, :, None]).sum(1),
        quats=unit_quaternions(quats),
        scales=still.scales * (motion.growth * elapsed[:, None]).exp(),
        opacities=still.opacities * torch.exp(-((elapsed / motion.width) ** 2)),
    )


def moved(motion: Motion, similarity: Similarity) -> Motion:
    """The motion of splats in the frame that ``similarity`` leads to (``transform_splats``)."""
    turn = quaternions_of(similarity.rotation.double()).expand_as(motion.spin)
    return replace(
        motion,
        path=similarity.scale * (motion.path @ similarity.rotation.T),
        spin=multiply_quaternions(turn, motion.spin),
    )


def in_world(file: MotionFile, world_from_scene: Similarity) -> MotionFile:
    """The file in the frame that a similarity leads to: contents and motion."""
    splats = transform_splats(file.content.splats, world_from_scene)
    content = replace(file.content, splats=splats)
    return replace(file, content=content, motion=moved(file.motion, world_from_scene))


def recentered(
    coefficients: Float[Tensor, "n powers d"], shift: Float[Tensor, " n"]
) -> Float[Tensor, "n powers d"]:
    """Coefficients of the same polynomials, from power 0, about an origin ``shift`` later."""
    # Synthetic division by Horner's rule, which needs no binomials.
    found = list(coefficients.unbind(1))
    for lowest in range(len(found) - 1):
        for power in reversed(range(lowest, len(found) - 1)):
            found[power] = found[power] + shift[:, None] * found[power + 1]
    return torch.stack(found, dim=1)
