"""Splines: smooth camera paths through poses.

Catmull-Rom splines with knots of any spacing (Barry and Goldman 1988), centripetal ones where no
times are given: these have no loops and no cusps (Yuksel et al. 2011). Rotations are quaternions
on the same spline, normalised.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Float64
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.maths.rotations import quaternions_of, same_half, unit_matrices

LEAST_STEP = 1e-4
"""Least distance of neighbouring knots, of the mean one, so that equal poses do no harm."""

STILL = 1e-6
"""A path shorter than this part of its reach is that of a camera that stands still."""

PARTS = 32
"""Pieces of a segment, along which its length is measured."""


class PoseSpline:
    """A smooth path through poses; ``closed`` leads from the last one to the first again."""

    def __init__(
        self,
        poses: Float[Tensor, "k 4 4"],
        knots: Float[Tensor, " knots"] | None = None,
        closed: bool = False,
    ) -> None:
        """A path through at least one pose.

        Args:
            poses: rigid camera-to-world transforms, in float64.
            knots: moment of each pose, ascending, and of the return to the first if closed;
                ``None`` for centripetal ones.
            closed: the path returns to its first pose.
        """
        poses = poses.double()
        if closed:
            poses = torch.cat([poses, poses[:1]])
        quats = [quaternions_of(poses[:, :3, :3])[0]]
        for quat in quaternions_of(poses[:, :3, :3])[1:]:
            quats.append(same_half(quat[None], quats[-1][None])[0])
        self._values = torch.cat([poses[:, :3, 3], torch.stack(quats)], dim=1)
        self._reach = _reach(poses)
        self._closed = closed and bool((self._values[0] - self._values[-1]).abs().max() < 1e-6)
        self.knots = _spaced(self._steps().sqrt()) if knots is None else knots.double()
        """Moment of each pose."""

    def at(self, moments: Float[Tensor, " f"]) -> Float64[Tensor, "f 4 4"]:
        """The poses at moments between the first knot and the last."""
        found = hermite(self._values, self.knots, moments, self._closed)
        poses = torch.eye(4, dtype=torch.float64).repeat(len(moments), 1, 1)
        poses[:, :3, :3] = unit_matrices(normalize(found[:, 3:], dim=1))
        poses[:, :3, 3] = found[:, :3]
        return poses

    def even_moments(self, frames: int) -> Float64[Tensor, " f"]:
        """Moments of a film that moves at one speed, from the first pose to the last.

        A closed path ends one frame before it is at its first pose again.
        """
        if len(self.knots) == 1:
            return self.knots.expand(frames).clone()
        fine = torch.cat(
            [
                torch.lerp(first, last, torch.arange(PARTS, dtype=torch.float64) / PARTS)
                for first, last in zip(self.knots[:-1], self.knots[1:], strict=True)
            ]
            + [self.knots[-1:]]
        )
        values = hermite(self._values, self.knots, fine, self._closed)
        steps = _lengths(values, self._reach)
        if float(steps.sum()) < STILL * self._reach:
            steps = fine.diff()
        passed = torch.cat([steps.new_zeros(1), steps.cumsum(0)])
        count = frames if self._closed else max(frames - 1, 1)
        wanted = torch.arange(frames, dtype=torch.float64) / count * passed[-1]
        return interpolate(fine, passed, wanted)

    def _steps(self) -> Float64[Tensor, " k_minus_1"]:
        return _lengths(self._values, self._reach)


def hermite(
    values: Float64[Tensor, "k d"],
    knots: Float64[Tensor, " k"],
    moments: Float[Tensor, " f"],
    closed: bool = False,
) -> Float64[Tensor, "f d"]:
    """Catmull-Rom splines through ``values``: cubic, with continuous velocities."""
    if len(knots) == 1:
        return values.expand(len(moments), -1)
    slopes = _slopes(values, knots, closed)
    moments = moments.double().clamp(knots[0], knots[-1])
    right = torch.searchsorted(knots, moments, right=True).clamp(1, len(knots) - 1)
    left = right - 1
    span = (knots[right] - knots[left])[:, None]
    u = (moments - knots[left])[:, None] / span
    return (
        (1 + 2 * u) * (1 - u) ** 2 * values[left]
        + u * (1 - u) ** 2 * span * slopes[left]
        + u**2 * (3 - 2 * u) * values[right]
        + u**2 * (u - 1) * span * slopes[right]
    )


def _slopes(
    values: Float64[Tensor, "k d"], knots: Float64[Tensor, " k"], closed: bool
) -> Float64[Tensor, "k d"]:
    """Velocity at each knot: that of the parabola through it and its neighbours."""
    spans = knots.diff()[:, None]
    chords = values.diff(dim=0) / spans
    if closed:
        spans, chords = (torch.cat([part[-1:], part, part[:1]]) for part in (spans, chords))
    else:
        ends = [chords[:1], chords, chords[-1:]]
        spans, chords = torch.cat([spans[:1], spans, spans[-1:]]), torch.cat(ends)
    before, after = spans[:-1], spans[1:]
    return (after * chords[:-1] + before * chords[1:]) / (before + after)


def interpolate(
    values: Float[Tensor, " k"], knots: Float[Tensor, " k"], moments: Float[Tensor, " f"]
) -> Float64[Tensor, " f"]:
    """Straight lines through ``values``, which never overshoot; constant beyond the ends."""
    values, knots, moments = values.double(), knots.double(), moments.double()
    if len(knots) == 1:
        return values.expand(len(moments)).clone()
    right = torch.searchsorted(knots, moments).clamp(1, len(knots) - 1)
    span = (knots[right] - knots[right - 1]).clamp_min(1e-300)
    return torch.lerp(
        values[right - 1], values[right], ((moments - knots[right - 1]) / span).clamp(0, 1)
    )


def _reach(poses: Float64[Tensor, "k 4 4"]) -> float:
    """Length that turning by one radian counts as: the mean distance from the middle."""
    centers = poses[:, :3, 3]
    return max(float((centers - centers.mean(0)).norm(dim=1).mean()), 1e-6)


def _lengths(values: Float64[Tensor, "k 7"], reach: float) -> Float64[Tensor, " k_minus_1"]:
    """Length of each step: that of its shift, and half of its turn."""
    shifts = values[:, :3].diff(dim=0).norm(dim=1)
    quats = normalize(values[:, 3:], dim=1)
    turns = 2 * (quats[1:] * quats[:-1]).sum(1).abs().clamp(max=1).acos()
    return (shifts**2 + (reach * turns / 2) ** 2).sqrt()


def _spaced(steps: Float64[Tensor, " k_minus_1"]) -> Float64[Tensor, " k"]:
    """Ascending knots."""
    if len(steps) == 0:
        return steps.new_zeros(1)
    least = max(float(steps.mean()) * LEAST_STEP, 1e-12)
    return torch.cat([steps.new_zeros(1), steps.clamp_min(least).cumsum(0)])
