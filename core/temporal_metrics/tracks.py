"""Tracks: positions of every row of a model at some times, and their error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.model import PrimitiveModel

OPAQUE = 0.5
"""A row of at least this opacity can represent a surface point."""
CHUNK = 1024
"""Number of points whose distances to all rows are computed at once."""


@dataclass(frozen=True)
class Tracks:
    """The paths of ``n`` rows over ``t`` times, in the frame of their source."""

    times: tuple[float, ...]
    """Times in [0, 1]."""
    positions: Float[Tensor, "t n 3"]
    """NaN where a row is not present."""
    opacities: Float[Tensor, "t n"]
    """Opacities in [0, 1]; 0 where a row is not present."""

    @property
    def present(self) -> Bool[Tensor, "t n"]:
        """True where a row is present."""
        return self.opacities > 0


@dataclass(frozen=True)
class TrackErrors:
    """Errors of tracks against true points that are always present; lengths in their unit.

    A point keeps its offset from its row, so that the density of rows has no effect.
    """

    moving: float
    """Median distance over all moving points and all later times; NaN if none moves."""
    moved: float
    """Median distance of the same points from their first position."""
    still: float
    """Median distance over all static points; NaN if all move."""

    @property
    def relative(self) -> float:
        """Error of moving points, relative to their motion."""
        return self.moving / self.moved


@torch.no_grad()
def follow(
    model: PrimitiveModel, times: Sequence[float], followed: Int[Tensor, " r"] | None = None
) -> Tracks:
    """The paths of rows of a model, in its scene frame and on its device.

    Args:
        model: the model.
        times: in [0, 1].
        followed: the rows; ``None`` for all.
    """
    positions: list[Tensor] = []
    opacities: list[Tensor] = []
    for time in times:
        device = next(iter(model.columns().values())).values.device
        splats = model.splats(torch.tensor(time, device=device))
        rows, means = splats.rows, splats.means
        if rows is None:
            rows = torch.arange(len(means), device=device)
        absent = means.new_full((model.num_rows, 3), torch.nan)
        places = absent.index_copy(0, rows, means)
        opaque = means.new_zeros(model.num_rows).index_copy(0, rows, splats.opacities)
        positions.append(places if followed is None else places[followed])
        opacities.append(opaque if followed is None else opaque[followed])
    return Tracks(tuple(times), torch.stack(positions), torch.stack(opacities))


def compare(
    tracks: Tracks,
    truth: Float[Tensor, "t p 3"],
    present: Bool[Tensor, "t p"],
    still_below: float,
) -> TrackErrors:
    """Error of true surface points that move with their nearest rows at the first time.

    Args:
        tracks: tracks of a model; rows that are not always present are ignored.
        truth: the true paths of points, at the same times and in the same frame.
        present: true where a point is present.
        still_below: points that never move farther from their first position are static.
    """
    truth = truth.to(tracks.positions)[:, present.all(0)]
    followed = tracks.positions[:, (tracks.opacities >= OPAQUE).all(0)]
    if followed.shape[1] == 0 or truth.shape[1] == 0 or len(truth) < 2:
        return TrackErrors(torch.nan, torch.nan, torch.nan)
    nearest = torch.cat(
        [torch.cdist(part, followed[0]).argmin(1) for part in truth[0].split(CHUNK)]
    )
    shifts = truth[1:] - truth[0]
    errors = (followed[1:, nearest] - followed[0, nearest] - shifts).norm(dim=2)
    moved = shifts.norm(dim=2)
    moves = moved.amax(0) > still_below
    return TrackErrors(
        _median(errors[:, moves]), _median(moved[:, moves]), _median(errors[:, ~moves])
    )


def _median(values: Tensor) -> float:
    return float(values.median()) if values.numel() else torch.nan
