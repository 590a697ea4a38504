"""Decimation: fewer splats that look nearly the same.

The splats that add least to the views are left out, pairs of the others are merged, and the
constant colours are refitted. Leaving out is best for a few, merging for many: how much is left out
first is tried, and the best by PSNR against the given splats is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from gsfw.core.contributions import most_useful
from gsfw.core.splats import Sh
from gsfw.editing.capture import row_mask
from gsfw.editing.editable import Editable
from gsfw.editing.merging import merged_down
from gsfw.editing.refit import Comparison, refitted

LEFT_OUT = (0.01, 0.03, 1.0)
"""Parts of all that is added to views, which may be left out before pairs are merged. At a half, a
quarter and a tenth of 7,568 splats of the built-in scene 0.01 gives 35.8, 27.7 and 23.0 dB before
refitting, 0.03 gives 36.5, 27.8 and 22.8, and 1 (no merging) 35.9, 22.3 and 16.1."""


@dataclass(frozen=True)
class Decimated:
    """Fewer splats."""

    piece: Editable
    psnr: float | None = None
    """PSNR of their views against those of the given ones, in dB; ``None`` where colours cannot be
    refitted, so that nothing is compared."""
    before_refit: float | None = None
    """The same with the colours as they were."""


def decimate(given: Editable, count: int) -> Decimated:
    """Decimate to exactly ``count`` splats, or rows of a model.

    The constant colours are refitted where they can be, and rows are merged unless it is changed in
    place.

    Args:
        given: more splats than that.
        count: number of splats that are left, at least 1.
    """
    scores = given.contributions().total
    if not given.can_refit():
        return Decimated(_fewer(given, scores, count, 1.0))
    comparison = Comparison.of(given.capture())
    targets = comparison.images(given.scene_splats())
    tried: list[tuple[float, Editable]] = []
    for part in LEFT_OUT[-1:] if given.in_place else LEFT_OUT:
        smaller = _fewer(given, scores, count, part)
        tried.append((comparison.psnr(smaller.scene_splats(), targets), smaller))
    before, best = max(tried, key=lambda item: item[0])
    fitted = refitted(best.scene_splats(), comparison, targets, best.contributions().total)
    psnr = comparison.psnr(fitted, targets)
    if not psnr > before:  # Colours were clamped, so that the problem is not linear.
        return Decimated(best, before, before)
    assert isinstance(fitted.colors, Sh)
    return Decimated(best.with_constants(fitted.colors.coefficients[:, 0]), psnr, before)


def _fewer(given: Editable, scores: Float[Tensor, " n"], count: int, part: float) -> Editable:
    """Leave out the least useful splats, at most ``part`` of all contributions; merge the rest."""
    unused = len(given) - count
    if part < 1:
        ordered = scores.sort().values
        unused = min(int((ordered.cumsum(0) < part * ordered.sum()).sum()), unused)
    rows = most_useful(scores, len(given) - unused)
    kept = given.keep(row_mask(rows, len(given)))
    if len(rows) == count:
        return kept
    return kept.with_splats(merged_down(kept.splats(), scores[rows], count))
