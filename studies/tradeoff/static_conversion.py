"""StaticConversion: rows that hardly move become still."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.storage import Cut, Storage
from gsfw.studies.tradeoff.subject import Subject

INSTANTS = 9
"""Times, spread evenly over the sequence, at which it is looked where rows are."""
MIDDLE = 0.5
"""The one of them that rows which become still keep looking as."""
THERE = 0.5
"""Of a row's largest opacity: where it is fainter the row has come or gone."""


@torch.no_grad()
def by_motion(subject: Subject) -> Int[Tensor, " n"]:
    """Rows of a model, those that move least first.

    Motion is the largest distance from where a row is in the middle of the sequence. A row that
    comes and goes is not still wherever it is: those come last, by how many times they miss.
    """
    device = next(iter(subject.model.columns().values())).values.device
    times = torch.linspace(0.0, 1.0, INSTANTS, device=device)
    found = [_everywhere(subject.splats(time), subject.model.num_rows) for time in times]
    means, opacities = (torch.stack(values) for values in zip(*found, strict=True))
    there = (opacities > 0) & (opacities >= THERE * opacities.amax(0))
    distances = (means - means[INSTANTS // 2]).norm(dim=2)
    order = distances.where(there, 0.0).amax(0).argsort(stable=True)
    return order[(~there).sum(0)[order].argsort(stable=True)]


def _everywhere(splats: Splats, count: int) -> tuple[Float[Tensor, "n 3"], Float[Tensor, " n"]]:
    """Where each row is, and how opaque: not at all for rows that are not drawn."""
    if splats.rows is None:
        return splats.means, splats.opacities
    means = splats.means.new_zeros(count, 3).index_copy(0, splats.rows, splats.means)
    return means, means.new_zeros(count).index_copy(0, splats.rows, splats.opacities)


@dataclass(frozen=True)
class StaticConversion(Cut):
    """Draws some rows as they are in the middle of the sequence, at all times.

    What is not there then is never drawn.
    """

    rows: Int[Tensor, " m"]
    """That become still."""
    held: Splats
    """As they look from now on, in order of rows."""

    @staticmethod
    def of(subject: Subject, rows: Int[Tensor, " m"]) -> StaticConversion:
        """Let some rows of a model look as they do in the middle."""
        middle = subject.splats(torch.tensor(MIDDLE, device=rows.device))
        return StaticConversion(rows, _chosen(middle, torch.isin(_rows(middle), rows)))

    def __call__(self, splats: Splats) -> Splats:
        """The splats of a time, in order of rows; those that are still as they are held."""
        if not len(self.rows):
            return splats
        changing = _chosen(splats, ~torch.isin(_rows(splats), self.rows))
        everything = _joined(changing, self.held)
        return everything.take(_rows(everything).argsort())

    def left_of(self, storage: Storage) -> Storage:
        """All but the time parameters of these rows."""
        return storage.without_time(self.rows)


def _rows(splats: Splats) -> Int[Tensor, " n"]:
    """The model row of each splat."""
    if splats.rows is not None:
        return splats.rows
    return torch.arange(len(splats), device=splats.means.device)


def _chosen(splats: Splats, mask: Bool[Tensor, " n"]) -> Splats:
    """Some splats, with their rows."""
    return replace(splats, rows=_rows(splats)).take(mask.nonzero()[:, 0])


def _joined(first: Splats, second: Splats) -> Splats:
    """The splats of two times of one model, one after the other."""
    colors, others = first.colors, second.colors
    if isinstance(colors, Sh) and isinstance(others, Sh):
        joined: Sh | Tensor = _joined_sh(colors, others)
    else:
        assert not isinstance(colors, Sh)
        assert not isinstance(others, Sh)
        joined = torch.cat([colors, others])
    return Splats(
        means=torch.cat([first.means, second.means]),
        opacities=torch.cat([first.opacities, second.opacities]),
        colors=joined,
        quats=_both(first.quats, second.quats),
        scales=_both(first.scales, second.scales),
        covariances=_both(first.covariances, second.covariances),
        extra=_both(first.extra, second.extra),
        rows=torch.cat([_rows(first), _rows(second)]),
    )


def _joined_sh(first: Sh, second: Sh) -> Sh:
    """Colours of one form, dense or ragged."""
    offsets = first.offsets
    if offsets is not None and second.offsets is not None:
        offsets = torch.cat([offsets, second.offsets[1:] + offsets[-1]])
    return Sh(
        torch.cat([first.coefficients, second.coefficients]),
        first.degree,
        _both(first.rest, second.rest),
        offsets,
    )


def _both(first: Tensor | None, second: Tensor | None) -> Tensor | None:
    return None if first is None or second is None else torch.cat([first, second])
