"""Contribution: how much each Gaussian adds to the training views, and who is left by that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.subject import Subject, in_dtype


@torch.no_grad()
def contributions(
    subject: Subject,
    cameras: Sequence[Cameras],
    advance: Callable[[int], None] | None = None,
) -> Float[Tensor, " n"]:
    """Sum over views and pixels of alpha times transmittance, of each of a still model's splats.

    Args:
        subject: whose rasterizer measures contributions.
        cameras: of the training views; no picture is needed.
        advance: is told how many views are done.
    """
    splats = subject.splats()
    settings = in_dtype(subject.model.settings(subject.settings), subject.dtype)
    settings = _measuring(settings)
    total = torch.zeros(len(splats), dtype=torch.float64, device=splats.means.device)
    for number, camera in enumerate(cameras, start=1):
        seen = subject.model.cameras(camera.to(splats.means.device, subject.dtype))
        output = subject.rasterizer.render(splats, seen, settings)
        assert output.statistics.contribution is not None
        total += output.statistics.contribution.sum(0).double()
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
    count = max(1, round(part * len(scores)))
    return scores.argsort(descending=True, stable=True)[:count].sort().values


@dataclass(frozen=True)
class Kept:
    """Leaves out every splat but some."""

    rows: Int[Tensor, " m"]

    def __call__(self, splats: Splats) -> Splats:
        """The splats of these rows."""
        colors = splats.colors
        if isinstance(colors, Sh) and colors.offsets is not None:
            starts, lengths = colors.offsets[:-1][self.rows], colors.offsets.diff()[self.rows]
            offsets = torch.cat([lengths.new_zeros(1), lengths.cumsum(0)])
            shift = (starts - offsets[:-1]).repeat_interleave(lengths)
            place = torch.arange(int(offsets[-1]), device=shift.device) + shift
            bare = replace(splats, colors=splats.means).map(lambda tensor: tensor[self.rows])
            return replace(bare, colors=Sh(colors.coefficients[place], colors.degree, offsets))
        return splats.map(lambda tensor: tensor[self.rows])
