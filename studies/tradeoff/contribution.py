"""Contribution: the share of each Gaussian in the training views, and pruning by it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.loop.contributions import highest_rows
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.studies.tradeoff.storage import Cut, Storage
from gsfw.studies.tradeoff.subject import Subject, in_dtype


@torch.no_grad()
def contributions(
    subject: Subject,
    cameras: Sequence[Cameras],
    advance: Callable[[int], None] | None = None,
) -> Float[Tensor, " n"]:
    """Sum over views and pixels of alpha times transmittance, of each splat or row of a model.

    Args:
        subject: whose rasterizer measures contributions; a moving one is rendered at the time of
            each view.
        cameras: of the training views; no photo is needed.
        advance: is told how many views are done.
    """
    splats = subject.splats()
    settings = _measuring(in_dtype(subject.settings, subject.dtype))
    count = len(splats) if subject.is_still else subject.model.num_rows
    total = torch.zeros(count, dtype=torch.float64, device=splats.means.device)
    for number, camera in enumerate(cameras, start=1):
        seen = camera.to(splats.means.device, subject.dtype)
        if not subject.is_still:
            splats = subject.splats(None if seen.time is None else seen.time[0])
        output = subject.rasterizer.render(splats, seen, settings)
        assert output.statistics.contribution is not None
        added = output.statistics.contribution.sum(0).double()
        total += (
            added
            if splats.rows is None
            else total.new_zeros(count).index_copy(0, splats.rows, added)
        )
        if advance is not None:
            advance(number)
    return total


def _measuring(settings: RenderSettings) -> RenderSettings:
    return replace(settings, statistics=frozenset({Statistic.CONTRIBUTION}))


def most_useful(scores: Float[Tensor, " n"], part: float) -> Int[Tensor, " m"]:
    """Rows of the highest scores, in order of rows; of equal ones the first.

    Args:
        scores: of each row.
        part: of all rows, in (0, 1]; at least one row is kept.
    """
    return highest_rows(scores, max(1, round(part * len(scores))))


@dataclass(frozen=True)
class Kept(Cut):
    """Leaves out every splat but those of some rows."""

    rows: Int[Tensor, " m"]

    def __call__(self, splats: Splats) -> Splats:
        """The splats of these rows, as far as they are among the given ones."""
        if splats.rows is None:
            return splats.take(self.rows)
        return splats.take(torch.isin(splats.rows, self.rows).nonzero()[:, 0])

    def left_of(self, storage: Storage) -> Storage:
        """The storage of these rows, and everything that belongs to no row."""
        return storage.of_rows(self.rows)
