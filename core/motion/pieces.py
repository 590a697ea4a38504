"""Pieces: rows of a moving model, cut in time until each piece moves in closed form.

A piece has a Gaussian window of opacity, a path of degree 3, a quaternion and logarithms of scales
that are linear in time. It fits if, at every sample, the errors of its position, shape and opacity
are within the bounds; otherwise it is cut in the middle, until it has two samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.exchange import Motion
from gsfw.core.motion.least_squares import fit_windows
from gsfw.core.motion.poses import Bounds, Poses, fit_moves
from gsfw.core.motion.samples import Samples
from gsfw.core.numerics import DEFAULT

SHORTEST = 2
"""Intervals of samples that are cut: a piece has one at least."""
TINY_WEIGHT = 1e-15
"""Weight of samples at which a row is present with an opacity of 0."""


@dataclass(frozen=True)
class Pieces:
    """Rows in pieces, with the values at each one's centre; a piece is a splat of a file."""

    rows: Int[Tensor, " p"]
    """Row of each piece."""
    seen_at: Int[Tensor, " p"]
    """A sample at which it is present, in the middle of its presence: that of its colour."""
    means: Float[Tensor, "p 3"]
    opacities: Float[Tensor, " p"]
    quats: Float[Tensor, "p 4"]
    scales: Float[Tensor, "p 3"]
    motion: Motion
    errors: Float[Tensor, " p"]
    """The largest error, relative to its bound; above 1 where a piece could not be cut."""

    def tensors(self) -> tuple[Tensor, ...]:
        """The values but the motion, in the order of the fields."""
        values = (self.rows, self.seen_at, self.means, self.opacities, self.quats, self.scales)
        return (*values, self.errors)

    @staticmethod
    def of(tensors: Iterable[Tensor], motion: Motion) -> Pieces:
        """The opposite of ``tensors``."""
        rows, seen_at, means, opacities, quats, scales, errors = tensors
        return Pieces(rows, seen_at, means, opacities, quats, scales, motion, errors)

    def take(self, chosen: Bool[Tensor, " p"] | Int[Tensor, " q"]) -> Pieces:
        """Some of the pieces."""
        return Pieces.of((value[chosen] for value in self.tensors()), self.motion.take(chosen))

    @staticmethod
    def cat(parts: Sequence[Pieces]) -> Pieces:
        """All pieces of several parts, at least one, whose rows do not overlap."""
        columns = zip(*(part.tensors() for part in parts), strict=True)
        joined = (torch.cat(column) for column in columns)
        return Pieces.of(joined, Motion.cat([part.motion for part in parts]))


def cut_to_pieces(samples: Samples, bounds: Bounds, *, cuts: bool) -> list[Pieces]:
    """The pieces of all rows that are seen at any time, in one part for each length.

    Args:
        samples: at two or more times, finite.
        bounds: of the errors.
        cuts: false to leave every row in one piece.
    """
    last = len(samples.times) - 1
    seen = (samples.opacities.amax(0) >= DEFAULT.alpha_min).nonzero()[:, 0]
    spans = _Spans(seen, torch.zeros_like(seen), torch.full_like(seen, last))
    found: list[Pieces] = []
    while len(spans.rows):
        pieces = _fitted(samples, spans, bounds)
        wrong = (pieces.errors > 1) & (spans.last - spans.first >= SHORTEST) & cuts
        found.append(pieces.take(~wrong & _is_seen(samples, spans)))
        spans = spans.halved(wrong)
    return found


@dataclass(frozen=True)
class _Spans:
    """Candidates: rows, and their first and last sample; neighbours share one."""

    rows: Int[Tensor, " p"]
    first: Int[Tensor, " p"]
    last: Int[Tensor, " p"]

    def halved(self, chosen: Bool[Tensor, " p"]) -> _Spans:
        """The halves of the chosen ones."""
        rows, first, last = self.rows[chosen], self.first[chosen], self.last[chosen]
        middle = (first + last) // 2
        return _Spans(rows.repeat(2), torch.cat([first, middle]), torch.cat([middle, last]))

    def samples(self) -> tuple[Int[Tensor, "p m"], Bool[Tensor, "p m"]]:
        """Indices of the samples of each, padded, and a mask of those that are."""
        index = self.first[:, None] + torch.arange(int((self.last - self.first).max()) + 1)
        return index.minimum(self.last[:, None]), index <= self.last[:, None]


def _is_seen(samples: Samples, spans: _Spans) -> Bool[Tensor, " p"]:
    """Candidates that are visible at any of their samples."""
    index, there = spans.samples()
    return ((samples.opacities[index, spans.rows[:, None]] >= DEFAULT.alpha_min) & there).any(1)


def _fitted(samples: Samples, spans: _Spans, bounds: Bounds) -> Pieces:
    """Fit all candidates, whatever their errors."""
    index, inside = spans.samples()
    rows = spans.rows[:, None]
    times, present = samples.times[index], samples.present[index, rows] & inside
    opacities = samples.opacities[index, rows] * present
    window = fit_windows(times, inside, opacities)
    weights = opacities + TINY_WEIGHT * present
    poses = Poses(
        samples.means[index, rows], samples.quats[index, rows], samples.scales[index, rows]
    )
    moves = fit_moves(poses, times, weights, window.center, bounds)
    relative = opacities / samples.opacities.amax(0)[rows]
    errors = poses.errors(moves.at(times), bounds) * relative
    fade = (window.at(times) - opacities).abs() * inside / bounds.opacity
    middle = (weights * times).sum(1) / weights.sum(1).clamp_min(TINY_WEIGHT)
    away = torch.where(present, (times - middle[:, None]).abs(), torch.inf)
    never, last = times.new_tensor(torch.inf), len(samples.times) - 1
    quats, spin = moves.unit_quaternions()
    return Pieces(
        rows=spans.rows,
        seen_at=index.gather(1, away.argmin(1, keepdim=True))[:, 0],
        means=moves.path[:, 0],
        opacities=window.peak,
        quats=quats,
        scales=moves.growth[:, 0].exp(),
        motion=Motion(
            center=window.center,
            width=window.width,
            begin=torch.where(spans.first > 0, samples.times[spans.first], -never),
            end=torch.where(spans.last < last, samples.times[spans.last], never),
            path=moves.path[:, 1:],
            spin=spin,
            growth=moves.growth[:, 1],
        ),
        errors=torch.maximum(errors, fade).amax(1),
    )
