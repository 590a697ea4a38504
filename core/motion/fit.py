"""The motion of any model in closed form: fitted to samples of its splats, in bounded memory.

Methods whose motion is of this form (spacetime, rotor4d) are found again to rounding, one piece for
each row; those that deform or track get as many pieces as their paths need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.exchange import MotionFile, SplatFile
from gsfw.core.model import PrimitiveModel
from gsfw.core.motion.pieces import Pieces, cut_to_pieces
from gsfw.core.motion.poses import Bounds
from gsfw.core.motion.samples import BYTES_PER_SAMPLE, present_among, sample, splats_at
from gsfw.core.progress import tracked
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats, cat_colors

MEMORY = 1 << 30
"""Bytes of samples held at once; a model with more is evaluated again for each part of its rows."""
BATCH = 4096
"""Rows that are fitted at once."""
FEWEST_INSTANTS = 33
"""Least number of samples: at 32 intervals a cubic is seen to bend."""
MOST_WITH_MIDDLES = 128
"""Times of the data up to which the middles between them are sampled too; the shortest windows,
which last half an interval, are then seen about six times."""
SAME_TIME = 1e-6
"""Distance of times that are one, in sequences."""
UNSEEN_SHIFT = 1e-4
"""Part of the scene's extent: a tenth of a pixel of an image of a thousand."""


@dataclass(frozen=True)
class FittedMotion:
    """The motion of a model in closed form, and its losses that can be told without a render."""

    file: MotionFile
    """In the scene frame."""
    num_rows: int
    """Rows of the model that are seen at any time."""
    num_unseen: int
    """Rows that are never seen, and left out."""
    num_dropped: int
    """Rows with values that are not finite, left out."""
    recolored: float
    """Change of the base colour over time that 99 % of the rows stay below: it is lost."""


def instants(data_times: Sequence[float]) -> tuple[float, ...]:
    """Times to sample a model at: those of the data, the middles between them, an even grid."""
    known = [0.0]
    known += [time for time in sorted(data_times) if SAME_TIME < time < 1 - SAME_TIME]
    known = [known[0], *(b for a, b in pairwise(known) if b - a > SAME_TIME), 1.0]
    further = [index / (FEWEST_INSTANTS - 1) for index in range(FEWEST_INSTANTS)]
    if len(known) <= MOST_WITH_MIDDLES:
        known += [(a + b) / 2 for a, b in pairwise(known)]
    if len(known) < FEWEST_INSTANTS:
        near = 0.25 / FEWEST_INSTANTS
        known += [time for time in further if min(abs(time - other) for other in known) > near]
    return tuple(sorted(known))


@torch.no_grad()
def fit_motion(
    model: PrimitiveModel,
    scene: Scene,
    data_times: Sequence[float],
    *,
    antialiased: bool = False,
    cuts: bool = True,
) -> FittedMotion:
    """Fit the motion of all rows of a moving model.

    Args:
        model: on any device.
        scene: of its capture, with times.
        data_times: the times of the data, in [0, 1].
        antialiased: true if the splats should be rendered with antialiasing.
        cuts: false for one piece for each row, however large its error.

    Raises:
        ValueError: nothing is seen at any time.
    """
    times, found = instants(data_times), _Found()
    at_once = max(BATCH, MEMORY // (BYTES_PER_SAMPLE * len(times)))
    for start in range(0, model.num_rows, at_once):
        rows = range(start, min(start + at_once, model.num_rows))
        found.add(model, times, rows, Bounds(UNSEEN_SHIFT * scene.extent), cuts)
    if not found.parts:
        raise ValueError("no splat is seen at any time")
    pieces = Pieces.cat(found.parts)
    splats = Splats(
        means=pieces.means,
        opacities=pieces.opacities,
        colors=cat_colors(found.colors),
        quats=pieces.quats,
        scales=pieces.scales,
    )
    seen = len(pieces.rows.unique())
    return FittedMotion(
        MotionFile(
            SplatFile(splats, antialiased=antialiased, up=scene.up),
            pieces.motion,
            time_range=scene.time_range,
            frames=max(len(set(data_times)), 1),
        ),
        num_rows=seen,
        num_unseen=model.num_rows - seen - found.dropped,
        num_dropped=found.dropped,
        recolored=float(torch.cat(found.recolored).double().quantile(0.99)),
    )


@dataclass
class _Found:
    """Pieces of the rows that are done."""

    parts: list[Pieces] = field(default_factory=list)
    colors: list[Sh | Tensor] = field(default_factory=list)
    recolored: list[Tensor] = field(default_factory=list)
    """Change of the base colour of each row that is seen."""
    dropped: int = 0
    """Rows that are not finite."""

    def add(
        self,
        model: PrimitiveModel,
        times: Sequence[float],
        rows: range,
        bounds: Bounds,
        cuts: bool,
    ) -> None:
        """Sample and cut some rows."""
        samples, broken = sample(model, times, rows).finite()
        self.dropped += broken
        batches = range(0, len(rows), BATCH)
        found = [
            replace(pieces, rows=pieces.rows + first)
            for first in tracked(batches, "fitting the motion", len(batches))
            for pieces in cut_to_pieces(
                samples.take(slice(first, first + BATCH)), bounds, cuts=cuts
            )
        ]
        if found:
            pieces = Pieces.cat(found)
            self.parts.append(replace(pieces, rows=pieces.rows + rows.start))
            self.colors.append(_colors(model, times, rows, pieces))
            self.recolored.append(samples.recolored[pieces.rows.unique()])


def _colors(
    model: PrimitiveModel, times: Sequence[float], rows: range, pieces: Pieces
) -> Sh | Float[Tensor, "p d"]:
    """Colours of pieces, each in the middle of its presence; dense."""
    found: list[Sh | Tensor] = []
    order: list[Tensor] = []
    for index in pieces.seen_at.unique().tolist():
        chosen = (pieces.seen_at == index).nonzero()[:, 0]
        splats = splats_at(model, times[index])
        place, (present, of_rows) = (
            torch.zeros(len(rows), dtype=torch.int64),
            present_among(splats, rows),
        )
        place[of_rows] = present.cpu()
        found.append(_dense(splats.colors, place[pieces.rows[chosen]]))
        order.append(chosen)
    return _taken(cat_colors(found), torch.cat(order).argsort())


def _dense(colors: Sh | Tensor, chosen: Int[Tensor, " r"]) -> Sh | Tensor:
    """Some of the colours, on the CPU."""
    if not isinstance(colors, Sh):
        return colors[chosen.to(colors.device)].cpu()
    found = colors.take(chosen.to(colors.coefficients.device))
    return Sh(found.dense().cpu(), colors.degree)


def _taken(colors: Sh | Tensor, rows: Int[Tensor, " r"]) -> Sh | Tensor:
    return colors.take(rows) if isinstance(colors, Sh) else colors[rows]
