"""Samples of a moving model: its rows at many times, with quaternions of consistent sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.maths.frame import with_axes
from gsfw.core.maths.rotations import quaternions_of, rotation_matrices, same_half
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Sh, Splats

SAME_SHAPE = 1e-5
"""Change of a covariance, relative to its trace, below which its axes are kept: rounding."""
BYTES_PER_SAMPLE = 60
"""Room for one row at one time: a dozen floats, and their selection."""


@dataclass(frozen=True)
class Samples:
    """Some rows of a model at k times, on the CPU, in the model's type."""

    times: Float[Tensor, " k"]
    """Ascending, in [0, 1]."""
    present: Bool[Tensor, "k n"]
    """False where a row is absent; its values are then 0."""
    means: Float[Tensor, "k n 3"]
    opacities: Float[Tensor, "k n"]
    quats: Float[Tensor, "k n 4"]
    """Quaternions of any norm; each in the half space of the one before."""
    scales: Float[Tensor, "k n 3"]
    recolored: Float[Tensor, " n"]
    """Change of the base colour while a row is present: its largest component, in [0, 1]."""

    def take(self, rows: slice) -> Samples:
        """The samples of some of the rows, in float64."""
        return Samples(
            self.times,
            self.present[:, rows],
            self.means[:, rows].double(),
            self.opacities[:, rows].double(),
            self.quats[:, rows].double(),
            self.scales[:, rows].double(),
            self.recolored[rows],
        )

    def finite(self) -> tuple[Samples, int]:
        """The same without rows of which a value is not finite, and their number."""
        values = (self.means, self.opacities[..., None], self.quats, self.scales)
        bad = torch.stack([~value.isfinite().all(2) for value in values]).any(0).any(0)
        if not bad.any():
            return self, 0
        kept = ~bad
        return replace(
            self,
            present=self.present & kept,
            means=torch.where(kept[:, None], self.means, 0.0),
            opacities=torch.where(kept, self.opacities, 0.0),
            quats=torch.where(kept[:, None], self.quats, 0.0),
            scales=torch.where(kept[:, None], self.scales, 0.0),
        ), int(bad.sum())


@torch.no_grad()
def sample(model: PrimitiveModel, times: Sequence[float], rows: range) -> Samples:
    """Evaluate some rows of a model at each time.

    Args:
        model: on any device.
        times: ascending, in [0, 1].
        rows: consecutive rows.
    """
    count, instants = len(rows), torch.tensor(times, dtype=torch.float64)
    places, like = _Places(count), next(iter(model.columns().values())).values
    like = torch.zeros(0, dtype=torch.promote_types(like.dtype, torch.float32))
    samples = Samples(
        instants,
        present=torch.zeros(len(times), count, dtype=torch.bool),
        means=like.new_zeros(len(times), count, 3),
        opacities=like.new_zeros(len(times), count),
        quats=like.new_zeros(len(times), count, 4),
        scales=like.new_zeros(len(times), count, 3),
        recolored=torch.zeros(count),
    )
    for index, time in enumerate(times):
        splats = splats_at(model, time)
        chosen, found = present_among(splats, rows)
        quats, scales = places.axes(found, splats, chosen)
        places.see(found, _base_colors(splats)[chosen].cpu())
        samples.present[index, found] = True
        samples.means[index, found] = splats.means[chosen].cpu()
        samples.opacities[index, found] = splats.opacities[chosen].cpu()
        samples.quats[index, found] = quats
        samples.scales[index, found] = scales
    return replace(samples, recolored=places.recolored())


def splats_at(model: PrimitiveModel, time: float) -> Splats:
    """The model's splats, on its device."""
    device = next(iter(model.columns().values())).values.device
    return model.splats(torch.tensor(time, device=device))


def present_among(splats: Splats, rows: range) -> tuple[Int[Tensor, " m"], Int[Tensor, " m"]]:
    """Indices of the splats of some rows, on their device; and their rows, from 0, on the CPU."""
    if splats.rows is None:
        return torch.arange(rows.start, rows.stop, device=splats.means.device), torch.arange(
            len(rows)
        )
    inside = (splats.rows >= rows.start) & (splats.rows < rows.stop)
    chosen = inside.nonzero()[:, 0]
    return chosen, (splats.rows[chosen] - rows.start).cpu()


def _base_colors(splats: Splats) -> Float[Tensor, "n d"]:
    colors = splats.colors
    return colors.coefficients[:, 0] * C0 if isinstance(colors, Sh) else colors[:, :3]


class _Places:
    """Knowledge of each row from earlier times: its axes, and the range of its colour."""

    def __init__(self, count: int) -> None:
        self._quats = torch.zeros(count, 4, dtype=torch.float64)
        self._scales = torch.zeros(count, 3, dtype=torch.float64)
        self._covariances: Tensor | None = None
        self._least = torch.full((count, 3), torch.inf)
        self._most = torch.full((count, 3), -torch.inf)

    def see(self, found: Int[Tensor, " m"], colors: Float[Tensor, "m d"]) -> None:
        """Remember the range of colours."""
        shown = torch.nn.functional.pad(colors.float(), (0, 3 - colors.shape[1]))
        self._least[found] = self._least[found].minimum(shown)
        self._most[found] = self._most[found].maximum(shown)

    def recolored(self) -> Float[Tensor, " n"]:
        """Change of the base colour of each row; 0 for rows that were never present."""
        return (self._most - self._least).amax(1).clamp_min(0.0)

    def axes(
        self, found: Int[Tensor, " m"], splats: Splats, chosen: Int[Tensor, " m"]
    ) -> tuple[Float[Tensor, "m 4"], Float[Tensor, "m 3"]]:
        """Quaternions in the half space of those before, and scales, of the chosen splats."""
        if splats.covariances is not None:
            self._turn(found, splats.covariances[chosen].cpu().double())
            return self._quats[found].to(splats.means.dtype), self._scales[found].to(
                splats.means.dtype
            )
        assert splats.quats is not None
        assert splats.scales is not None
        quats = splats.quats[chosen].cpu()
        quats = same_half(quats, self._quats[found].to(quats))
        self._quats[found] = quats.double()
        return quats, splats.scales[chosen].cpu()

    def _turn(self, found: Int[Tensor, " m"], covariances: Float[Tensor, "m 3 3"]) -> None:
        """Find the axes of shapes that are new or have changed, in the order of those before."""
        if self._covariances is None:
            self._covariances = covariances.new_full((len(self._quats), 3, 3), torch.nan)
        sizes = covariances.diagonal(dim1=1, dim2=2).sum(1)
        changes = (covariances - self._covariances[found]).abs().amax((1, 2))
        changed = (~(changes <= SAME_SHAPE * sizes)).nonzero()[:, 0]  # New rows have NaN.
        if len(changed) == 0:
            return
        rows, shapes = found[changed], covariances[changed]
        before = self._quats[rows]
        quats, scales = _principal_axes(shapes)
        is_known = (before != 0).any(1, keepdim=True)
        ordered, sizes = _in_order_of(before, quats, scales)
        quats = torch.where(is_known, same_half(ordered, before), quats)
        self._quats[rows], self._scales[rows] = quats, torch.where(is_known, sizes, scales)
        self._covariances[rows] = shapes


def _principal_axes(
    covariances: Float[Tensor, "m 3 3"],
) -> tuple[Float[Tensor, "m 4"], Float[Tensor, "m 3"]]:
    zeros = covariances[:, 0, 0] * 0
    turned = with_axes(Splats(covariances[:, 0], zeros, covariances[:, 0], covariances=covariances))
    assert turned.quats is not None
    assert turned.scales is not None
    return turned.quats, turned.scales


def _in_order_of(
    before: Float[Tensor, "m 4"], quats: Float[Tensor, "m 4"], scales: Float[Tensor, "m 3"]
) -> tuple[Float[Tensor, "m 4"], Float[Tensor, "m 3"]]:
    """The same shapes with axes named and directed as nearly as possible as ``before``."""
    axes = rotation_matrices(quats)
    overlaps = rotation_matrices(before).transpose(1, 2) @ axes
    orders = torch.tensor(list(permutations(range(3))))
    scores = overlaps.abs()[:, torch.arange(3), orders].sum(2)
    chosen = orders[scores.argmax(1)]
    axes = axes.gather(2, chosen[:, None].expand(-1, 3, -1))
    along = overlaps.gather(2, chosen[:, None].expand(-1, 3, -1)).diagonal(dim1=1, dim2=2)
    axes = axes * torch.where(along < 0, -1.0, 1.0)[:, None]
    mirrored = axes.det() < 0
    least = torch.nn.functional.one_hot(along.abs().argmin(1), 3).bool()
    axes = torch.where((mirrored[:, None] & least)[:, None], -axes, axes)
    return quaternions_of(axes), scales.gather(1, chosen)
